"""A picture is refused by what its head declares, before anything of that size is allocated."""

import resource
import struct
import zlib
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest

from pix2face.errors import InputFileError
from pix2face.files.images import decode_image, read_photograph
from pix2face.files.picture_head import declared_size_px
from pix2face.files.picture_size import check_decodes, read_size_px

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
    assert declared_size_px(BytesIO(content)) == (SIDE_PX, SIDE_PX)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    message = r"bomb.*at most 256 megapixels.*60000 x 60000"
    for refuse in (
        lambda: read_size_px(path),
        lambda: check_decodes(content, "bomb"),
        lambda: decode_image(content, "bomb"),
        lambda: read_photograph(path),
    ):
        with pytest.raises(InputFileError, match=message):
            refuse()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # KB


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".bmp", ".webp", ".tif"])
def test_heads_declare_what_decodes(suffix: str) -> None:
    content = encoded(suffix)
    assert declared_size_px(BytesIO(content)) == (20, 33)
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


@pytest.mark.parametrize(
    "start", [b"II*\0", b"MM\0*", b"BM", b"RIFF\0\0\0\0WEBPVP8L", b"RIFF\0\0\0\0WEBPVP8X", b"GIF89a"]
)
def test_heads_that_end_early_declare_nothing(start: bytes) -> None:
    assert declared_size_px(BytesIO(start)) is None
