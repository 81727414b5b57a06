"""What the head of a picture file says: its size, held against the memory that decoding takes, and its orientation."""

import re
import struct
from collections.abc import Callable, Mapping
from contextlib import suppress
from io import SEEK_END, BufferedReader, BytesIO
from typing import Any, NamedTuple

from PIL import (
    BmpImagePlugin,
    GifImagePlugin,
    Jpeg2KImagePlugin,
    JpegImagePlugin,
    PngImagePlugin,
    PpmImagePlugin,
    TiffImagePlugin,
    WebPImagePlugin,
)
from PIL.Image import Exif
from PIL.ImageFile import ImageFile

from pix2face.errors import InputFileError

JPEG_START = b"\xff\xd8"
TIFF_STARTS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")  # the latter two of BigTIFF
ORIENTATION = 274  # the tag that says how viewers turn the stored pixels
# 1 is upright; 5 to 8 exchange width and height.
UPRIGHT, ON_ITS_SIDE = 1, (5, 6, 7, 8)
# A file of some kilobytes may declare a picture that no memory holds.
LARGEST_PICTURE_PX = 1 << 28
LARGEST_DECODING_BYTES = 1 << 30
# Encoders make ten or so. Each is a pass over the whole picture, of which a file of a megabyte could ask for thousands.
MOST_SCANS = 100


class _UnknownFormatError(Exception):
    """The file begins like none of the formats that are read."""


class _Head(NamedTuple):
    """How to open the head of a format, and the memory that OpenCV decodes it in."""

    open: Callable[[BytesIO | BufferedReader], ImageFile]
    bytes_per_pixel: int


# Opened by format, since `PIL.Image.open` has a limit of its own that belongs to the whole process.
_HEADS: Mapping[bytes, _Head] = {
    JPEG_START: _Head(JpegImagePlugin.JpegImageFile, 3),
    b"\x89PNG": _Head(PngImagePlugin.PngImageFile, 6),
    b"BM": _Head(BmpImagePlugin.BmpImageFile, 3),
    b"RIFF": _Head(WebPImagePlugin.WebPImageFile, 7),
    b"GIF8": _Head(GifImagePlugin.GifImageFile, 16),
    **{b"P%d" % kind: _Head(PpmImagePlugin.PpmImageFile, 6) for kind in range(1, 7)},
    **dict.fromkeys((b"\0\0\0\x0c", b"\xff\x4f\xff\x51"), _Head(Jpeg2KImagePlugin.Jpeg2KImageFile, 16)),
}
_AVIF_BYTES_PER_PIXEL, _AVIF_HEAD_BYTES, _PROGRESSIVE_BYTES_PER_PIXEL = 9, 1 << 16, 9
# JPEG markers: segments that state their length, frames that every decoder knows, one of them of several passes.
_JPEG_SEGMENTS = frozenset((0xC4, 0xDB, 0xDD, *range(0xE0, 0xF0), 0xFE))
_JPEG_FRAMES, _JPEG_PROGRESSIVE, _JPEG_SCAN = frozenset((0xC0, 0xC1, 0xC2)), 0xC2, 0xDA
_TIFF_WIDTHS, _TIFF_HEIGHTS, _TIFF_BITS, _TIFF_SAMPLES = (256, 322), (257, 323), 258, 277


def declared_size_px(content: bytes | BufferedReader, where: str) -> tuple[int, int]:
    """Height and width as the head of a picture declares them, before anything is decoded.

    They are those of the stored pixels: the orientation tag is not applied.

    Raises:
        InputFileError: The head is damaged or of an unknown format, or declares a picture that takes more memory than
            `LARGEST_DECODING_BYTES`, or a JPEG of more than `MOST_SCANS` passes.
    """
    file = BytesIO(content) if isinstance(content, bytes) else content
    try:
        plain = _size_of_plain_jpeg(content) if isinstance(content, bytes) else None
        width, height, bytes_per_pixel = plain or _size_from_head(file)
    except Exception as error:
        found = "that are none" if isinstance(error, _UnknownFormatError) else f"with a damaged head ({error})"
        raise InputFileError(
            f"{where}: expected a picture (JPEG, PNG, ...), found {file.seek(0, SEEK_END)} bytes {found}"
        ) from error
    largest_px = min(LARGEST_PICTURE_PX, LARGEST_DECODING_BYTES // bytes_per_pixel)
    if height * width > largest_px:
        raise InputFileError(
            f"{where}: expected a picture of at most {largest_px >> 20} megapixels, found a head that declares "
            f"{width} x {height} pixels"
        )
    return height, width


def orientation_tag(content: bytes | BufferedReader) -> int:
    """The tag of a picture file, 1 to 8; 1 (upright) where it has none that can be read."""
    if isinstance(content, bytes) and content.startswith(JPEG_START) and b"Exif" not in content:
        return UPRIGHT  # Pillow would take ten times as long
    file = BytesIO(content) if isinstance(content, bytes) else content
    file.seek(0)
    start = file.read(4)
    file.seek(0)
    found: Any = None
    with suppress(Exception):  # Pillow raises many kinds of errors for damaged tags; such tags count as none
        if start in TIFF_STARTS:
            found = _tiff_tags(file).get(ORIENTATION)
        else:
            head = next(head for magic, head in _HEADS.items() if start.startswith(magic))
            exif = Exif()  # not `getexif`, which decodes a PNG
            exif.load(head.open(file).info.get("exif", b""))
            found = exif.get(ORIENTATION)
    return int(found) if found in range(UPRIGHT, 9) else UPRIGHT


def _tiff_tags(file: BytesIO | BufferedReader) -> TiffImagePlugin.ImageFileDirectory_v2:
    """The tags of a TIFF file; PIL opens fewer kinds than OpenCV, but reads the tags of all."""
    head = file.read(8)
    head += file.read(8) if b"+" in head[:4] else b""
    tags = TiffImagePlugin.ImageFileDirectory_v2(head)
    file.seek(tags.next)
    tags.load(file)
    return tags


def _size_from_head(file: BytesIO | BufferedReader) -> tuple[int, int, int]:
    """Width, height, and the memory for a pixel while the picture is decoded."""
    start = file.read(12)
    file.seek(0)
    if start[:4] in TIFF_STARTS:
        return _size_of_tiff(file)
    if start[4:8] == b"ftyp":
        return _size_of_avif(file.read(_AVIF_HEAD_BYTES))
    head = next((head for magic, head in _HEADS.items() if start.startswith(magic)), None)
    if head is None:
        raise _UnknownFormatError
    width, height = head.open(file).size
    if min(width, height) < 1:
        raise ValueError(f"{width} x {height} pixels")
    if start.startswith(JPEG_START):
        file.seek(0)
        _check_scans(file.read())
        return width, height, _PROGRESSIVE_BYTES_PER_PIXEL
    return width, height, head.bytes_per_pixel


def _size_of_plain_jpeg(content: bytes) -> tuple[int, int, int] | None:
    """As `_size_from_head`; None where anything but ordinary segments precedes the data, or for another format.

    A training decodes a picture for every sample. Pillow takes ten times as long to open one.
    """
    place, size, n_channels, is_progressive = 2, (0, 0), 0, False
    while content.startswith(JPEG_START) and place + 10 <= len(content) and content[place] == 0xFF:
        marker, length = content[place + 1], int.from_bytes(content[place + 2 : place + 4])
        if marker in _JPEG_FRAMES:
            size, n_channels = struct.unpack_from(">HH", content, place + 5), content[place + 9]
            is_progressive = marker == _JPEG_PROGRESSIVE
        elif marker == _JPEG_SCAN and min(size) > 0:
            if is_progressive or content[place + 4] != n_channels:
                _check_scans(content)
                return size[1], size[0], _PROGRESSIVE_BYTES_PER_PIXEL
            return size[1], size[0], _HEADS[JPEG_START].bytes_per_pixel
        elif marker not in _JPEG_SEGMENTS or length < 2:
            return None
        place += 2 + length
    return None


def _check_scans(content: bytes) -> None:
    n_scans = content.count(b"\xff\xda")
    if n_scans > MOST_SCANS:
        raise ValueError(f"{n_scans} scans, where at most {MOST_SCANS} are decoded")


def _size_of_tiff(file: BytesIO | BufferedReader) -> tuple[int, int, int]:
    """As `_size_from_head`."""
    tags = _tiff_tags(file)
    # Tiles are decoded whole, and may be larger than the picture.
    width, height = (max(int(tags[tag]) for tag in both if tag in tags) for both in (_TIFF_WIDTHS, _TIFF_HEIGHTS))
    if min(int(tags[_TIFF_WIDTHS[0]]), int(tags[_TIFF_HEIGHTS[0]])) < 1:
        raise ValueError(f"{width} x {height} pixels")
    n_bytes = -(-max(map(int, tags.get(_TIFF_BITS, (8,)))) // 8)
    return width, height, 3 + n_bytes * max(3, int(tags.get(_TIFF_SAMPLES, 1)))


def _size_of_avif(head: bytes) -> tuple[int, int, int]:
    """As `_size_from_head`: of the largest of its pictures (boxes ``ispe``, ISO/IEC 23008-12)."""
    sizes = [struct.unpack_from(">II", head, found.end() + 4) for found in re.finditer(rb"ispe", head[:-12])]
    width, height = max(sizes, key=lambda size: size[0] * size[1])
    return width, height, _AVIF_BYTES_PER_PIXEL
