"""Reads and writes pictures, and defines what OpenCV leaves open: RGB, 8 bit, orientation, size limit and errors."""

import stat
import struct
from collections.abc import Callable, Mapping
from io import SEEK_END, BufferedReader, BytesIO
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Shaped, UInt8, UInt16
from numpy import ndarray
from PIL import BmpImagePlugin, JpegImagePlugin, PngImagePlugin, TiffImagePlugin, WebPImagePlugin
from PIL.ImageFile import ImageFile

from pix2face.errors import InputFileError

PHOTOGRAPH_QUALITY = 95
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff")
# 16384 x 16384: no camera takes larger pictures, and one of them decodes to 800 MB. A file of some kilobytes may
# declare a picture that no memory holds.
LARGEST_PICTURE_PX = 1 << 28

# Opened by format, since `PIL.Image.open` has a limit of its own that belongs to the whole process.
_HEADS: Mapping[bytes, Callable[[BytesIO | BufferedReader], ImageFile]] = {
    b"\xff\xd8": JpegImagePlugin.JpegImageFile,
    b"\x89PNG": PngImagePlugin.PngImageFile,
    b"BM": BmpImagePlugin.BmpImageFile,
    b"RIFF": WebPImagePlugin.WebPImageFile,
}
# JPEG markers of segments that state their length, and of the frames that every decoder knows.
_JPEG_SEGMENTS = frozenset((0xC4, 0xDB, 0xDD, *range(0xE0, 0xF0), 0xFE))
_JPEG_FRAMES = frozenset((0xC0, 0xC1, 0xC2))
_TIFF_STARTS = (b"II*\0", b"MM\0*")
_TIFF_WIDTH, _TIFF_HEIGHT = 256, 257


def read_photograph(path: Path) -> UInt8[ndarray, "h w 3"]:
    """Reads a picture as people see it: orientation tag applied, grey, alpha and 16 bit brought to 8-bit RGB.

    Raises:
        InputFileError: There is no such file, or it cannot be decoded.
    """
    image = _decode(read_bytes(path), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR, str(path))
    return cv2.cvtColor(_to_8_bit(image), cv2.COLOR_BGR2RGB)


def read_bytes(path: Path) -> bytes:
    """Reads a file whole.

    Raises:
        InputFileError: The file is missing, cannot be read, or is not a regular file (a device, a pipe).
    """
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise InputFileError(f"{path}: expected a picture, found a folder; name the pictures in it")
        if not stat.S_ISREG(mode):
            raise InputFileError(f"{path}: expected a picture, found a device, pipe or socket; name a file")
        return path.read_bytes()
    except OSError as error:
        raise InputFileError(f"{path}: expected a picture, cannot read it ({error.strerror})") from error


def decode_image(content: bytes, where: str) -> UInt8[ndarray, "h w 3"]:
    """Decodes a JPEG or PNG file to RGB.

    The orientation tag is not applied: coefficient files refer to the stored pixels.

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


def read_size_px(path: Path) -> tuple[int, int]:
    """Height and width of a stored picture, from the head of its file; formats without a known head are decoded.

    Damage further on in the file is not noticed.

    Raises:
        InputFileError: No regular file, no picture, or more pixels than `LARGEST_PICTURE_PX`.
    """
    if not path.is_file():
        raise InputFileError(f"{path}: expected a picture, found {'no ordinary file' if path.exists() else 'nothing'}")
    try:
        with path.open("rb") as file:
            size = declared_size_px(file, str(path))
    except OSError as error:
        raise InputFileError(f"{path}: expected a picture, cannot read it ({error.strerror})") from error
    if size is None or min(size) < 1:
        height, width = decode_image(read_bytes(path), str(path)).shape[:2]
        return height, width
    return size


def declared_size_px(content: bytes | BufferedReader, where: str) -> tuple[int, int] | None:
    """Height and width as the head of a picture declares them, before anything is decoded; None for unknown formats.

    Raises:
        InputFileError: The head is damaged, or declares more pixels than `LARGEST_PICTURE_PX`.
    """
    file = BytesIO(content) if isinstance(content, bytes) else content
    start = file.read(4)
    open_head = next((head for magic, head in _HEADS.items() if start.startswith(magic)), None)
    file.seek(0)
    try:
        if isinstance(content, bytes) and (size := _size_of_plain_jpeg(content)):
            width, height = size
        elif start in _TIFF_STARTS:
            width, height = _size_of_tiff(file)
        elif open_head is not None:
            width, height = open_head(file).size
        else:
            return None
    except Exception as error:
        n_bytes = file.seek(0, SEEK_END)
        raise InputFileError(
            f"{where}: expected a picture (JPEG, PNG, ...), found {n_bytes} bytes with a damaged head ({error})"
        ) from error
    if height * width > LARGEST_PICTURE_PX:
        raise InputFileError(
            f"{where}: expected a picture of at most {LARGEST_PICTURE_PX >> 20} megapixels, found a head that declares "
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


def _size_of_plain_jpeg(content: bytes) -> tuple[int, int] | None:
    """Width and height; None where anything but ordinary segments comes before the frame, or for another format.

    A training decodes a picture for every sample. Pillow takes ten times as long to open one.
    """
    place = 2
    while content.startswith(b"\xff\xd8") and place + 9 <= len(content) and content[place] == 0xFF:
        marker, length = content[place + 1], int.from_bytes(content[place + 2 : place + 4])
        if marker in _JPEG_FRAMES:
            height, width = struct.unpack_from(">HH", content, place + 5)
            return width, height
        if marker not in _JPEG_SEGMENTS or length < 2:
            return None
        place += 2 + length
    return None


def _size_of_tiff(file: BytesIO | BufferedReader) -> tuple[int, int]:
    """Width and height; PIL opens fewer kinds of TIFF files than OpenCV, but reads the tags of all."""
    tags = TiffImagePlugin.ImageFileDirectory_v2(file.read(8))
    file.seek(tags.next)
    tags.load(file)
    return int(tags[_TIFF_WIDTH]), int(tags[_TIFF_HEIGHT])


def _to_8_bit(image: Shaped[ndarray, "h w 3"]) -> UInt8[ndarray, "h w 3"]:
    if image.dtype == np.uint16:
        return (image >> 8).astype(np.uint8)
    if image.dtype != np.uint8:
        return (np.nan_to_num(np.clip(image, 0, 1)) * 255).astype(np.uint8)
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
