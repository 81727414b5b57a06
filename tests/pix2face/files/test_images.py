"""Pictures as cameras, scanners and drawing programs leave them, read as people see them."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pix2face.errors import InputFileError
from pix2face.files.images import (
    decode_image,
    encode_image,
    encode_photograph,
    read_bytes,
    read_photograph,
    upright_bytes,
)
from pix2face.files.picture_head import orientation_tag

# Where each Exif orientation puts the picture on the screen, from the stored rows and columns.
AS_SEEN = {
    1: lambda stored: stored,
    2: lambda stored: stored[:, ::-1],
    3: lambda stored: stored[::-1, ::-1],
    4: lambda stored: stored[::-1],
    5: lambda stored: stored.transpose(1, 0, 2),
    6: lambda stored: np.rot90(stored, -1),
    7: lambda stored: stored[::-1, ::-1].transpose(1, 0, 2),
    8: np.rot90,
}


def picture() -> np.ndarray:
    """Blocks of different colours, coarse enough for JPEG; taller than wide."""
    colours = np.array([[[230, 30, 30], [30, 200, 40]], [[20, 40, 220], [240, 240, 60]], [[0, 0, 0], [255, 255, 255]]])
    return np.kron(colours, np.ones((16, 16, 1))).astype(np.uint8)


def jpeg(image: np.ndarray) -> bytes:
    return cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()


def with_orientation(content: bytes, orientation: int) -> bytes:
    """A JPEG with an Exif segment that holds the orientation tag (0x0112) and nothing else."""
    tag = b"\x01\x12" + b"\x00\x03" + b"\x00\x00\x00\x01" + bytes([0, orientation]) + b"\x00\x00"
    tiff = b"MM\x00\x2a\x00\x00\x00\x08" + b"\x00\x01" + tag + b"\x00\x00\x00\x00"
    body = b"Exif\x00\x00" + tiff
    return content[:2] + b"\xff\xe1" + (len(body) + 2).to_bytes(2, "big") + body + content[2:]


def write(path: Path, image: np.ndarray) -> Path:
    assert cv2.imwrite(str(path), image)
    return path


@pytest.mark.parametrize("orientation", AS_SEEN)
def test_the_orientation_tag_is_applied_to_photographs(tmp_path: Path, orientation: int) -> None:
    path = tmp_path / "photograph.jpg"
    path.write_bytes(with_orientation(jpeg(picture()), orientation))
    found, expected = read_photograph(path), AS_SEEN[orientation](picture())
    assert found.shape == expected.shape
    assert np.abs(found.astype(int) - expected).mean() < 4


@pytest.mark.parametrize("orientation", AS_SEEN)
def test_stored_pictures_look_the_same_whether_the_tag_is_applied_or_not(orientation: int) -> None:
    content = upright_bytes(with_orientation(jpeg(picture()), orientation), "here")
    found = decode_image(content, "here")
    assert orientation_tag(content) == 1
    assert np.abs(found.astype(int) - AS_SEEN[orientation](picture())).mean() < 8
    np.testing.assert_array_equal(found, cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)[..., ::-1])


def test_the_orientation_tag_is_left_alone_in_stored_pictures() -> None:
    plain = jpeg(picture())
    np.testing.assert_array_equal(decode_image(with_orientation(plain, 6), "here"), decode_image(plain, "here"))


def test_red_is_first(tmp_path: Path) -> None:
    found = read_photograph(write(tmp_path / "picture.png", picture()[..., ::-1]))
    np.testing.assert_array_equal(found, picture())
    assert found.dtype == np.uint8


def test_grey_becomes_three_equal_channels(tmp_path: Path) -> None:
    grey = picture()[..., 1]
    found = read_photograph(write(tmp_path / "grey.png", grey))
    np.testing.assert_array_equal(found, np.repeat(grey[..., None], 3, axis=2))


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".webp"])
def test_alpha_is_dropped(tmp_path: Path, suffix: str) -> None:
    opaque = np.dstack([picture()[..., ::-1], np.full(picture().shape[:2], 255, np.uint8)])
    found = read_photograph(write(tmp_path / f"alpha{suffix}", opaque))
    assert found.shape == picture().shape
    assert np.abs(found.astype(int) - picture()).mean() < 2


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
@pytest.mark.parametrize("channels", [1, 3, 4])
def test_16_bit_keeps_its_upper_8(tmp_path: Path, suffix: str, channels: int) -> None:
    deep = (picture()[..., ::-1].astype(np.uint16) << 8) + 255
    if channels == 4:
        deep = np.dstack([deep, np.full(deep.shape[:2], 65535, np.uint16)])
    expected = picture() if channels > 1 else np.repeat(picture()[..., 2:], 3, axis=2)
    found = read_photograph(write(tmp_path / f"deep{suffix}", deep[..., 0] if channels == 1 else deep))
    np.testing.assert_array_equal(found, expected)


def test_floating_point_is_taken_from_0_to_1(tmp_path: Path) -> None:
    values = np.array([[[-1, 0, 0.5], [1, 2, 0.25]]], dtype=np.float32)
    found = read_photograph(write(tmp_path / "float.tiff", values[..., ::-1]))
    np.testing.assert_array_equal(found, [[[0, 0, 127], [255, 255, 63]]])


def test_grey_fractions_are_read_without_a_word(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    values = np.array([[-1, 0, 0.5], [1, 2, np.nan]], dtype=np.float32)
    found = read_photograph(write(tmp_path / "grey.tiff", values))
    np.testing.assert_array_equal(found, np.array([[0, 0, 127], [255, 255, 0]])[..., None].repeat(3, axis=2))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("channels", [1, 3])
def test_fractions_are_stored_as_every_program_reads_them(tmp_path: Path, channels: int) -> None:
    values = (np.repeat(picture()[..., 1:2], 3, axis=2) if channels == 1 else picture()) / np.float32(255)
    path = write(tmp_path / "float.tiff", values[..., 0] if channels == 1 else values[..., ::-1])
    assert np.abs(decode_image(upright_bytes(read_bytes(path), "here"), "here") / 255 - values).mean() < 0.03


def test_numbers_that_are_no_picture_are_named_alike_wherever_they_are_read(tmp_path: Path) -> None:
    path = write(tmp_path / "wide.tiff", np.zeros((4, 4), np.int32))
    for read in (lambda: read_photograph(path), lambda: upright_bytes(read_bytes(path), str(path))):
        with pytest.raises(InputFileError, match=r"wide\.tiff: expected a picture of 8 or 16 bits .*found .* of int32"):
            read()


def test_whole_numbers_are_stored_as_they_are(tmp_path: Path) -> None:
    for numbers in (picture(), picture().astype(np.uint16) << 8):
        content = read_bytes(write(tmp_path / "whole.tiff", numbers))
        assert upright_bytes(content, "here") is content


def test_undefined_floating_point_is_black_or_clipped(tmp_path: Path) -> None:
    values = np.array([[[np.nan, -np.inf, np.inf]]], dtype=np.float32)
    found = read_photograph(write(tmp_path / "nan.tiff", values[..., ::-1]))
    np.testing.assert_array_equal(found, [[[0, 0, 255]]])


def test_a_grey_file_of_a_shard_becomes_rgb() -> None:
    grey = cv2.imencode(".png", picture()[..., 0])[1].tobytes()
    assert decode_image(grey, "here").shape == picture().shape


def test_encoding_loses_nothing() -> None:
    image = np.random.default_rng(0).integers(0, 256, (17, 23, 3)).astype(np.uint8)
    np.testing.assert_array_equal(decode_image(encode_image(image), "here"), image)


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"", "0 bytes that are none"),
        (b"no picture", "10 bytes that are none"),
        (jpeg(picture())[:20], "20 bytes with a damaged head"),
        (jpeg(picture())[:-60], "a JPEG that is cut off or damaged"),
        (encode_image(picture())[:60], "a PNG that is cut off or damaged"),
    ],
)
def test_what_is_no_picture_is_named(tmp_path: Path, content: bytes, found: str) -> None:
    path = tmp_path / "broken.jpg"
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=rf"broken\.jpg: expected a picture .*found {found}"):
        read_photograph(path)
    with pytest.raises(InputFileError, match="sample 7: expected a picture"):
        decode_image(content, "sample 7")


def test_photographs_are_encoded_as_jpeg_close_to_what_they_show() -> None:
    x, y = np.meshgrid(np.arange(64), np.arange(48))
    image = np.stack([4 * x, 5 * y, 128 + x - y], axis=-1).astype(np.uint8)
    content = encode_photograph(image)
    assert content.startswith(b"\xff\xd8")
    assert encode_photograph(image) == content
    assert np.abs(decode_image(content, "test").astype(float) - image).mean() < 2
