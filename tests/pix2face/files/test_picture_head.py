"""Sizes from the heads of files are those of the decoded pictures, and refused before that much is allocated."""

import resource
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.Image import Exif

from pix2face.errors import InputFileError
from pix2face.files.images import check_decodes, decode_image, read_photograph, read_size_px, upright_bytes
from pix2face.files.picture_head import declared_size_px, orientation_tag

SIDE_PX = 60_000


def png_chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png_bomb(side_px: int = SIDE_PX) -> bytes:
    head = struct.pack(">IIBBBBB", side_px, side_px, 8, 2, 0, 0, 0)
    rows = zlib.compress(bytes(100_000))
    return b"\x89PNG\r\n\x1a\n" + png_chunk(b"IHDR", head) + png_chunk(b"IDAT", rows) + png_chunk(b"IEND", b"")


def jpeg_bomb() -> bytes:
    content = bytearray(encoded(".jpg"))
    place = content.index(b"\xff\xc0")
    content[place + 5 : place + 9] = struct.pack(">HH", SIDE_PX, SIDE_PX)
    return bytes(content)


def bmp_bomb() -> bytes:
    content = bytearray(encoded(".bmp"))
    content[18:26] = struct.pack("<ii", SIDE_PX, -SIDE_PX)
    return bytes(content)


def tiff_bomb() -> bytes:
    content = encoded(".tif")
    for tag in (256, 257):
        for kind in (3, 4):
            entry = struct.pack("<HHI", tag, kind, 1)
            if entry in content:
                place = content.index(entry)
                value = struct.pack("<HHII", tag, 4, 1, SIDE_PX)
                content = content[:place] + value + content[place + 12 :]
    return content


def encoded(suffix: str, shape: tuple[int, ...] = (20, 33, 3)) -> bytes:
    image = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    return cv2.imencode(suffix, image)[1].tobytes()


BOMBS = {"png": png_bomb, "jpg": jpeg_bomb, "bmp": bmp_bomb, "tif": tiff_bomb}


@pytest.mark.parametrize("kind", BOMBS)
def test_a_bomb_is_refused_without_being_decoded(kind: str, tmp_path: Path) -> None:
    content, path = BOMBS[kind](), tmp_path / f"bomb.{kind}"
    path.write_bytes(content)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    message = r"bomb.*at most \d+ megapixels.*60000 x 60000"
    for refuse in (
        lambda: read_size_px(path),
        lambda: check_decodes(content, "bomb"),
        lambda: decode_image(content, "bomb"),
        lambda: read_photograph(path),
    ):
        with pytest.raises(InputFileError, match=message):
            refuse()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # KB


@pytest.mark.parametrize(
    "before", [b"\xff\xe1\0\x0d\xff\xc0\0\x08\x08\0\1\0\1\0\0", b"\xff", b"\xff\xfe\0\2", b"\xff\xd0"]
)
def test_nothing_before_its_frame_hides_the_size_of_a_jpeg(before: bytes) -> None:
    content = jpeg_bomb()
    with pytest.raises(InputFileError, match="picture: expected a picture"):
        declared_size_px(content[:2] + before + content[2:], "picture")


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".bmp", ".webp", ".tif"])
def test_heads_declare_what_decodes(suffix: str) -> None:
    content = encoded(suffix)
    assert declared_size_px(content, "picture") == (20, 33)
    check_decodes(content, "picture")


@pytest.mark.parametrize("suffix", [".jpg", ".png"])
@pytest.mark.parametrize("kept", [0.02, 0.3, 0.9, 0.99])
def test_a_truncated_picture_is_found_at_an_eighth(suffix: str, kept: float) -> None:
    content = encoded(suffix, (90, 120, 3))
    with pytest.raises(InputFileError, match="expected a picture"):
        check_decodes(content[: int(kept * len(content))], "picture")


def test_a_jpeg_without_its_end_is_found() -> None:
    with pytest.raises(InputFileError, match="expected a picture"):
        check_decodes(encoded(".jpg", (90, 120, 3))[:-2], "picture")


@pytest.mark.parametrize("start", [b"II*\0", b"MM\0*", b"BM", b"RIFF\0\0\0\0WEBPVP8L", b"RIFF\0\0\0\0WEBPVP8X"])
def test_heads_that_end_early_are_refused(start: bytes) -> None:
    with pytest.raises(InputFileError, match=r"picture: expected a picture .*bytes with a damaged head"):
        declared_size_px(start, "picture")


@pytest.mark.parametrize("content", [b"GIF89a", b"P5 300", b"\xff\x4f\xff\x51", b"\0\0\0\x1cftypavif"])
def test_heads_of_rarer_formats_that_end_early_are_refused(content: bytes) -> None:
    with pytest.raises(InputFileError, match=r"picture: expected a picture .* with a damaged head"):
        declared_size_px(content, "picture")


@pytest.mark.parametrize("suffix", [".gif", ".pgm", ".ppm", ".pbm", ".jp2", ".avif"])
def test_rarer_formats_are_read(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"picture{suffix}"
    if not cv2.imwrite(str(path), np.full((70, 90) if suffix in (".pgm", ".pbm") else (70, 90, 3), 255, np.uint8)):
        pytest.skip(f"this OpenCV writes no {suffix}")
    assert read_size_px(path) == (70, 90)
    assert read_photograph(path).shape == (70, 90, 3)


def gif(width: int, height: int) -> bytes:
    return (
        b"GIF89a"
        + struct.pack("<HH", width, height)
        + b"\x00\0\0,"
        + struct.pack("<HHHH", 0, 0, width, height)
        + b"\0\2\0;"
    )


@pytest.mark.parametrize("content", [gif(32000, 32000), b"P4\n32000 32000\n", b"P5\n32000 32000\n255\n"])
def test_a_bomb_of_a_rarer_format_is_refused(content: bytes) -> None:
    with pytest.raises(InputFileError, match="megapixels, found a head that declares 32000 x 32000 pixels"):
        check_decodes(content + bytes(1000), "picture")


def test_a_jpeg_of_many_passes_is_refused() -> None:
    content = cv2.imencode(".jpg", np.zeros((64, 64, 3), np.uint8), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    check_decodes(content, "picture")
    last = content[content.rindex(b"\xff\xda") : -2]
    with pytest.raises(InputFileError, match="1010 scans, where at most 100 are decoded"):
        check_decodes(content[:-2] + 1000 * last + b"\xff\xd9", "picture")


def test_numbers_that_are_no_brightness_are_refused(tmp_path: Path) -> None:
    head = [(256, 8), (257, 8), (258, 8), (259, 1), (262, 1), (273, 200), (277, 1), (278, 8), (279, 64), (339, 2)]
    entries = b"".join(struct.pack("<HHIHH", tag, 3, 1, value, 0) for tag, value in head)  # 339, 2: with signs
    content = b"II*\0" + struct.pack("<IH", 8, len(head)) + entries + bytes(4)
    (tmp_path / "signed.tif").write_bytes(content.ljust(264, b"\xff"))
    with pytest.raises(InputFileError, match=r"signed\.tif: .* 8 or 16 bits or of fractions, found numbers of int8"):
        read_photograph(tmp_path / "signed.tif")


def test_progressive_jpeg_and_long_heads_are_understood(tmp_path: Path) -> None:
    path = tmp_path / "picture.jpg"
    cv2.imwrite(str(path), np.zeros((33, 55, 3), np.uint8), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])
    content = path.read_bytes()
    # A thumbnail in the head is a picture of its own, which must not be taken for this one.
    comment = b"\xff\xe1" + (65_000).to_bytes(2, "big") + (content + bytes(65_000))[:64_998]
    path.write_bytes(content[:2] + comment + content[2:])
    assert read_size_px(path) == (33, 55)


def test_the_photographs_at_hand_have_their_decoded_size(shared_dir: Path) -> None:
    paths = [path for path in sorted((shared_dir / "data").rglob("*")) if path.suffix in (".jpg", ".png")]
    assert len(paths) > 400
    for path in [*paths[:20], *paths[400:]]:
        assert read_size_px(path) == decode_image(path.read_bytes(), path.name).shape[:2]


def test_no_damage_hangs_or_crashes(tmp_path: Path) -> None:
    path = tmp_path / "picture.jpg"
    cv2.imwrite(str(path), np.full((33, 55, 3), 9, np.uint8))
    content, rng = path.read_bytes(), np.random.default_rng(0)
    for _ in range(300):
        damaged = bytearray(content[: rng.integers(1, len(content))])
        for position in rng.integers(len(damaged), size=4):
            damaged[position] = rng.integers(256)
        path.write_bytes(damaged)
        try:
            height, width = read_size_px(path)
        except InputFileError:
            continue
        assert 0 < height < 65_536
        assert 0 < width < 65_536


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp", "tif", "big.tif"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_size_is_that_of_the_picture_as_people_see_it(tmp_path: Path, suffix: str, orientation: int) -> None:
    tags, path = Exif(), tmp_path / f"picture.{suffix}"
    tags[274] = orientation
    Image.fromarray(np.zeros((20, 33, 3), np.uint8)).save(path, exif=tags, big_tiff=suffix == "big.tif")
    assert orientation_tag(path.read_bytes()) == orientation
    assert read_size_px(path) == read_photograph(path).shape[:2] == ((33, 20) if orientation > 4 else (20, 33))


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".bmp", ".webp", ".tif"])
def test_a_picture_without_an_orientation_stays_byte_for_byte(suffix: str) -> None:
    content = encoded(suffix)
    assert orientation_tag(content) == orientation_tag(content[:60]) == orientation_tag(b"") == 1
    assert upright_bytes(content, "picture") is content
