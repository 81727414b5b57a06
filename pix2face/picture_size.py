"""Height and width of a picture from the head of its file: decoding a hundred thousand photographs takes minutes."""

import struct
from pathlib import Path
from typing import BinaryIO

from pix2face.errors import InputFileError
from pix2face.images import decode_image, read_bytes

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
# Start of frame: C0 to CF, without tables (C4), extensions (C8) and arithmetic coding (CC).
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
# Markers that stand alone.
_WITHOUT_LENGTH = frozenset((0x01, *range(0xD0, 0xD8)))
_END_OF_HEAD = frozenset((0xD9, 0xDA))


def read_size_px(path: Path) -> tuple[int, int]:
    """Height and width as the file declares them, for JPEG and PNG; other formats are decoded.

    A picture that is damaged further on is not noticed here.

    Raises:
        InputFileError: No ordinary file, or no picture.
    """
    if not path.is_file():
        raise InputFileError(f"{path}: expected a picture, found {'no ordinary file' if path.exists() else 'nothing'}")
    try:
        with path.open("rb") as file:
            start = file.read(24)
            size = _size_of_png(start) if start.startswith(_PNG) else None
            if start.startswith(_JPEG):
                file.seek(2)
                size = _size_of_jpeg(file)
    except OSError as error:
        raise InputFileError(f"{path}: expected a picture, cannot read it ({error.strerror})") from error
    if size is None or min(size) < 1:
        height, width = decode_image(read_bytes(path), str(path)).shape[:2]
        return height, width
    return size


def _size_of_png(start: bytes) -> tuple[int, int] | None:
    if len(start) < 24 or start[12:16] != b"IHDR":
        return None
    width, height = struct.unpack(">II", start[16:24])
    return height, width


def _size_of_jpeg(file: BinaryIO) -> tuple[int, int] | None:
    while True:
        if file.read(1) != b"\xff":
            return None
        while (marker := file.read(1)) == b"\xff":
            pass
        if not marker or marker[0] in _END_OF_HEAD:
            return None
        if marker[0] in _WITHOUT_LENGTH:
            continue
        segment = file.read(7 if marker[0] in _FRAMES else 2)
        if len(segment) < 2:
            return None
        if marker[0] in _FRAMES:
            if len(segment) < 7:
                return None
            height, width = struct.unpack(">HH", segment[3:7])
            return height, width
        file.seek(int.from_bytes(segment, "big") - 2, 1)
