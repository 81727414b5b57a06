"""Sizes from the heads of files are those of the decoded pictures."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pix2face.errors import InputFileError
from pix2face.files.images import decode_image
from pix2face.files.picture_size import read_size_px


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".bmp", ".webp", ".tif"])
@pytest.mark.parametrize("shape", [(17, 40, 3), (300, 20)])
def test_every_format_gives_the_decoded_size(tmp_path: Path, suffix: str, shape: tuple[int, ...]) -> None:
    path = tmp_path / f"picture{suffix}"
    cv2.imwrite(str(path), np.zeros(shape, np.uint8))
    assert read_size_px(path) == shape[:2]


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


@pytest.mark.parametrize("content", [b"", b"\xff\xd8", b"\xff\xd8\xff\xc0\x00", b"\x89PNG\r\n\x1a\n", b"text"])
def test_what_is_no_picture_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "picture.jpg"
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=r"picture\.jpg: expected a picture"):
        read_size_px(path)


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


def test_folders_and_missing_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match="no ordinary file"):
        read_size_px(tmp_path)
    with pytest.raises(InputFileError, match="found nothing"):
        read_size_px(tmp_path / "none.jpg")
