"""Reads and writes pictures, and defines what OpenCV leaves open: RGB, 8 bit, orientation, size limit and errors."""

import re
import struct
from collections.abc import Callable, Mapping
from io import SEEK_END, BufferedReader, BytesIO
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Shaped, UInt8, UInt16
from numpy import ndarray
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
from PIL.ImageFile import ImageFile

from pix2face.errors import InputFileError
from pix2face.files.heif import decode_heic, heic_size_px, is_heic
from pix2face.files.opening import open_regular, read_regular
from pix2face.files.orientation import ON_ITS_SIDE, UPRIGHT, orientation_tag

PHOTOGRAPH_QUALITY = 95
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff")
PHOTOGRAPH_SUFFIXES = (*IMAGE_SUFFIXES, ".avif", ".heic", ".heif")  # of what people photograph with
# No camera makes larger files or pictures. A file of some kilobytes may declare a picture that no memory holds.
LARGEST_FILE_BYTES = 1 << 30
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
    b"\xff\xd8": _Head(JpegImagePlugin.JpegImageFile, 3),
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
_TIFF_STARTS = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_TIFF_WIDTHS, _TIFF_HEIGHTS, _TIFF_BITS, _TIFF_SAMPLES = (256, 322), (257, 323), 258, 277


def read_photograph(path: Path) -> UInt8[ndarray, "h w 3"]:
    """Reads a picture as people see it: orientation tag applied, grey, alpha and 16 bit brought to 8-bit RGB.

    Raises:
        InputFileError: There is no such file, or it cannot be decoded.
    """
    return _as_seen(read_bytes(path), str(path))


def read_bytes(path: Path) -> bytes:
    """Reads the file of a picture.

    Raises:
        InputFileError: The file is missing, too large, cannot be read, or is not a regular file (a device, a pipe).
    """
    return read_regular(path, "a picture", LARGEST_FILE_BYTES)


def decode_image(content: bytes, where: str) -> UInt8[ndarray, "h w 3"]:
    """Decodes a JPEG or PNG file to RGB.

    The orientation tag is not applied: this is for pictures in shards, which have none (``upright_bytes``).

    Raises:
        InputFileError: It cannot be decoded.
    """
    image = _decode(content, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION, where)
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def check_decodes(content: bytes, where: str) -> None:
    """Makes sure that a picture decodes, at an eighth of its size, which takes a quarter of the time for a JPEG.

    All bytes are read all the same, so a truncated file is found.

    Raises:
        InputFileError: It cannot be decoded.
    """
    _decode(content, cv2.IMREAD_REDUCED_GRAYSCALE_8 | cv2.IMREAD_IGNORE_ORIENTATION, where)


def upright_bytes(content: bytes, where: str) -> bytes:
    """A picture file without an orientation tag that turns it: itself, or what people see, encoded anew as JPEG.

    Some programs apply the tag and some do not. A picture without one looks the same to all of them.

    Raises:
        InputFileError: It has such a tag and cannot be decoded.
    """
    if orientation_tag(content) == UPRIGHT and not is_heic(content):
        return content
    return encode_photograph(_as_seen(content, where))


def read_orientation(path: Path) -> int:
    """The orientation tag of a picture file; errors as ``read_size_px``."""
    with open_regular(path, "a picture", LARGEST_FILE_BYTES) as file:
        return orientation_tag(file)


def read_size_px(path: Path) -> tuple[int, int]:
    """Height and width of a picture as people see it (orientation tag applied), from the head of its file.

    Damage further on in the file is not noticed.

    Raises:
        InputFileError: No regular file, no picture, or one that takes more memory than `LARGEST_DECODING_BYTES`.
    """
    with open_regular(path, "a picture", LARGEST_FILE_BYTES) as file:
        size = declared_size_px(file, str(path))
        file.seek(0)
        if is_heic(file.read(256)):
            file.seek(0)
            return heic_size_px(file.read(), str(path))
        return size[::-1] if orientation_tag(file) in ON_ITS_SIDE else size


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


def encode_image(image: UInt8[ndarray, "h w *c"] | UInt16[ndarray, "h w *c"]) -> bytes:
    """Encodes a picture (RGB, RGBA or grey) without loss, as PNG."""
    channels = image.shape[2] if image.ndim == 3 else 1
    code = {3: cv2.COLOR_RGB2BGR, 4: cv2.COLOR_RGBA2BGRA}.get(channels)
    return bytes(cv2.imencode(".png", image if code is None else cv2.cvtColor(image, code))[1])


def encode_photograph(
    image: UInt8[ndarray, "h w 3"], quality: int = PHOTOGRAPH_QUALITY, *, is_colour_halved: bool = True
) -> bytes:
    """Encodes an RGB picture as JPEG: a fifth of the size of PNG, in a tenth of its time (docs/explanation/storage.md).

    The quality is 1 to 100. With ``is_colour_halved``, colour has half the resolution of brightness, as in most
    photographs.
    """
    sampling = cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420 if is_colour_halved else cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444
    flags = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling]
    return bytes(cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), flags)[1])


def srgb_to_linear(values: Float[ndarray, "*n"]) -> Float[ndarray, "*n"]:
    """Linear light from values as pictures store them, both 0..1. Source: IEC 61966-2-1."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(light: Float[ndarray, "*n"]) -> Float[ndarray, "*n"]:
    """The inverse of `srgb_to_linear`."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055)


def _size_from_head(file: BytesIO | BufferedReader) -> tuple[int, int, int]:
    """Width, height, and the memory for a pixel while the picture is decoded."""
    start = file.read(12)
    file.seek(0)
    if start[:4] in _TIFF_STARTS:
        return _size_of_tiff(file)
    if start[4:8] == b"ftyp":
        return _size_of_avif(file.read(_AVIF_HEAD_BYTES))
    head = next((head for magic, head in _HEADS.items() if start.startswith(magic)), None)
    if head is None:
        raise _UnknownFormatError
    width, height = head.open(file).size
    if min(width, height) < 1:
        raise ValueError(f"{width} x {height} pixels")
    if start.startswith(b"\xff\xd8"):
        file.seek(0)
        _check_scans(file.read())
        return width, height, _PROGRESSIVE_BYTES_PER_PIXEL
    return width, height, head.bytes_per_pixel


def _size_of_plain_jpeg(content: bytes) -> tuple[int, int, int] | None:
    """As `_size_from_head`; None where anything but ordinary segments precedes the data, or for another format.

    A training decodes a picture for every sample. Pillow takes ten times as long to open one.
    """
    place, size, n_channels, is_progressive = 2, (0, 0), 0, False
    while content.startswith(b"\xff\xd8") and place + 10 <= len(content) and content[place] == 0xFF:
        marker, length = content[place + 1], int.from_bytes(content[place + 2 : place + 4])
        if marker in _JPEG_FRAMES:
            size, n_channels = struct.unpack_from(">HH", content, place + 5), content[place + 9]
            is_progressive = marker == _JPEG_PROGRESSIVE
        elif marker == _JPEG_SCAN and min(size) > 0:
            if is_progressive or content[place + 4] != n_channels:
                _check_scans(content)
                return size[1], size[0], _PROGRESSIVE_BYTES_PER_PIXEL
            return size[1], size[0], _HEADS[b"\xff\xd8"].bytes_per_pixel
        elif marker not in _JPEG_SEGMENTS or length < 2:
            return None
        place += 2 + length
    return None


def _check_scans(content: bytes) -> None:
    n_scans = content.count(b"\xff\xda")
    if n_scans > MOST_SCANS:
        raise ValueError(f"{n_scans} scans, where at most {MOST_SCANS} are decoded")


def _size_of_tiff(file: BytesIO | BufferedReader) -> tuple[int, int, int]:
    """As `_size_from_head`; PIL opens fewer kinds of TIFF files than OpenCV, but reads the tags of all."""
    head = file.read(8)
    head += file.read(8) if b"+" in head[:4] else b""
    tags = TiffImagePlugin.ImageFileDirectory_v2(head)
    file.seek(tags.next)
    tags.load(file)
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


def _as_seen(content: bytes, where: str) -> UInt8[ndarray, "h w 3"]:
    if is_heic(content):
        declared_size_px(content, where)
        return decode_heic(content, where)
    # In the file's own colours: OpenCV cannot turn grey fractions into RGB while it reads them.
    image = _to_8_bit(_decode(content, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR, where), where)
    return cv2.cvtColor(image, cv2.COLOR_GRAY2RGB if image.ndim == 2 else cv2.COLOR_BGR2RGB)


def _to_8_bit(image: Shaped[ndarray, "h w *c"], where: str) -> UInt8[ndarray, "h w *c"]:
    if image.dtype == np.uint16:
        return np.right_shift(image, 8, out=image).astype(np.uint8)
    if image.dtype.kind == "f":
        return (np.nan_to_num(np.clip(image, 0, 1)) * 255).astype(np.uint8)
    if image.dtype != np.uint8:
        raise InputFileError(
            f"{where}: expected a picture of 8 or 16 bits or of fractions, found numbers of {image.dtype}"
        )
    return image


def _decode(content: bytes, flags: int, where: str) -> Shaped[ndarray, "h w *c"]:
    declared_size_px(content, where)
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags) if content else None
    except cv2.error as error:
        raise InputFileError(f"{where}: expected a picture that OpenCV reads; {error.err}") from error
    if image is None:
        raise InputFileError(f"{where}: expected a picture (JPEG, PNG, ...), found {len(content)} bytes that are none")
    return image
