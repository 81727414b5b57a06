"""Height and width of a picture as the head of its file declares them, before anything is decoded.

A file of some kilobytes may declare a picture that no memory holds. Formats: JPEG, PNG, BMP, WebP, TIFF.
"""

import struct
from io import BufferedIOBase, BytesIO

from pix2face.errors import InputFileError

# 16384 x 16384: no camera takes larger pictures, and one of them decodes to 800 MB.
LARGEST_PICTURE_PX = 1 << 28
# What of a file is enough for every format but JPEG and TIFF, whose sizes may stand anywhere.
HEAD_BYTES = 32

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
# Start of frame: C0 to CF, without tables (C4), extensions (C8) and arithmetic coding (CC).
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
# Markers that stand alone.
_WITHOUT_LENGTH = frozenset((0x01, *range(0xD0, 0xD8)))
_END_OF_HEAD = frozenset((0xD9, 0xDA))
# Tags of width and height, and sizes of the types that they may have (short, long).
_TIFF_WIDTH, _TIFF_HEIGHT = 256, 257
_TIFF_TYPES = {3: "H", 4: "I"}
_TIFF_MOST_TAGS = 4096


def check_declared_size(content: bytes, where: str) -> None:
    """Refuses a picture whose head declares more pixels than any camera takes.

    Raises:
        InputFileError: It does.
    """
    check_size(declared_size_px(BytesIO(content)), where)


def check_size(size_px: tuple[int, int] | None, where: str) -> None:
    """Refuses a size that a head declares, if there is one and it is too large.

    Raises:
        InputFileError: It is.
    """
    if size_px is not None and size_px[0] * size_px[1] > LARGEST_PICTURE_PX:
        raise InputFileError(
            f"{where}: expected a picture of at most {LARGEST_PICTURE_PX >> 20} megapixels, found a head that declares "
            f"{size_px[1]} x {size_px[0]} pixels"
        )


def declared_size_px(file: BufferedIOBase) -> tuple[int, int] | None:
    """Height and width; None where the head declares none, or is of no format known here.

    Args:
        file: Open at its start, can be searched.
    """
    start = file.read(HEAD_BYTES)
    try:
        if start.startswith(_JPEG):
            file.seek(2)
            return _size_of_jpeg(file)
        if start[:2] in (b"II", b"MM"):
            return _size_of_tiff(file, start)
        return _size_in_head(start)
    except (struct.error, IndexError):
        return None  # it ends before its size


def _size_in_head(start: bytes) -> tuple[int, int] | None:
    if start.startswith(_PNG) and start[12:16] == b"IHDR":
        width, height = struct.unpack(">II", start[16:24])
        return height, width
    if start.startswith(b"BM"):
        width, height = struct.unpack("<ii", start[18:26])
        return abs(height), abs(width)  # a negative height counts rows from the top
    if start[:4] == b"RIFF" and start[8:12] == b"WEBP" and len(start) >= 30:
        return _size_of_webp(start)
    return None


def _size_of_webp(start: bytes) -> tuple[int, int] | None:
    kind = start[12:16]
    if kind == b"VP8X":
        width, height = (int.from_bytes(start[place : place + 3], "little") + 1 for place in (24, 27))
        return height, width
    if kind == b"VP8L":
        bits = int.from_bytes(start[21:25], "little")
        return (bits >> 14 & 0x3FFF) + 1, (bits & 0x3FFF) + 1
    if kind == b"VP8 ":
        width, height = struct.unpack("<HH", start[26:30])
        return height & 0x3FFF, width & 0x3FFF
    return None


def _size_of_tiff(file: BufferedIOBase, start: bytes) -> tuple[int, int] | None:
    order = "<" if start[:2] == b"II" else ">"
    magic, place = struct.unpack(f"{order}HI", start[2:8])
    if magic != 42:
        return None
    file.seek(place)
    (count,) = struct.unpack(f"{order}H", file.read(2))
    found: dict[int, int] = {}
    for _ in range(min(count, _TIFF_MOST_TAGS)):
        entry = file.read(12)
        tag, kind = struct.unpack(f"{order}HH", entry[:4])
        if tag in (_TIFF_WIDTH, _TIFF_HEIGHT) and kind in _TIFF_TYPES:
            (found[tag],) = struct.unpack_from(f"{order}{_TIFF_TYPES[kind]}", entry, 8)
    return (found[_TIFF_HEIGHT], found[_TIFF_WIDTH]) if len(found) == 2 else None


def _size_of_jpeg(file: BufferedIOBase) -> tuple[int, int] | None:
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
            height, width = struct.unpack(">HH", segment[3:7])
            return height, width
        file.seek(int.from_bytes(segment[:2], "big") - 2, 1)
