"""Reads and writes pictures, and defines what OpenCV leaves open: RGB, 8 bit, orientation, size limit and errors."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, Shaped, UInt8, UInt16
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.heif import decode_heic, heic_size_px, is_heic
from pix2face.files.opening import open_regular, read_regular
from pix2face.files.picture_head import (
    JPEG_START,
    ON_ITS_SIDE,
    TIFF_STARTS,
    UPRIGHT,
    declared_size_px,
    orientation_tag,
)
from pix2face.files.writing import write_file

PHOTOGRAPH_QUALITY = 95
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff")
PHOTOGRAPH_SUFFIXES = (*IMAGE_SUFFIXES, ".avif", ".heic", ".heif")  # of what people photograph with
# First bytes of files, for messages about damaged ones.
SIGNATURES = ((JPEG_START, "JPEG"), (b"\x89PNG", "PNG"))
# No camera makes larger files.
LARGEST_FILE_BYTES = 1 << 30
# In the file's own numbers and colours: OpenCV cannot turn grey fractions into RGB while it reads them.
_AS_STORED = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR


def read_photograph(path: Path) -> UInt8[ndarray, "h w 3"]:
    """Reads a picture as people see it: orientation tag applied, grey, alpha and 16 bit brought to 8-bit RGB.

    Raises:
        InputFileError: There is no such file, or it cannot be decoded.
    """
    return _as_seen(read_bytes(path), str(path))


def read_cutout(path: Path) -> UInt8[ndarray, "h w 4"]:
    """Reads a picture with its transparency: 8-bit RGBA, opaque if it has none.

    Raises:
        InputFileError: As for ``read_photograph``.
    """
    image = _to_8_bit(_decode(read_bytes(path), cv2.IMREAD_UNCHANGED, str(path)), str(path))
    n_channels = 1 if image.ndim == 2 else image.shape[2]
    return cv2.cvtColor(image, {1: cv2.COLOR_GRAY2RGBA, 3: cv2.COLOR_BGR2RGBA, 4: cv2.COLOR_BGRA2RGBA}[n_channels])


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

    Some programs apply the tag and some do not. A picture without one looks the same to all of them. Pictures that few
    programs read (HEIC, fractions) are encoded anew as well.

    Raises:
        InputFileError: It has such a tag and cannot be decoded, or holds numbers that `read_photograph` does not read.
    """
    if orientation_tag(content) == UPRIGHT and not is_heic(content):
        return in_whole_numbers(content, where)
    return encode_photograph(_as_seen(content, where))


def in_whole_numbers(content: bytes, where: str) -> bytes:
    """A picture file of 8 or 16 bits: itself, or the fractions of a TIFF, encoded anew as JPEG.

    Raises:
        InputFileError: It is a TIFF that cannot be decoded, or that holds other numbers.
    """
    if content[:4] not in TIFF_STARTS or _decode(content, _AS_STORED, where).dtype in (np.uint8, np.uint16):
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
        # Counting the passes of a JPEG needs the whole file anyway, and its size and tag are found faster in memory.
        content = file.read() if file.peek(2).startswith(JPEG_START) else file
        size = declared_size_px(content, str(path))
        is_on_its_side = orientation_tag(content) in ON_ITS_SIDE
        file.seek(0)
        if is_heic(file.read(256)):
            file.seek(0)
            return heic_size_px(file.read(), str(path))
        return size[::-1] if is_on_its_side else size


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


def write_picture(path: Path, image: UInt8[ndarray, "h w 3"]) -> None:
    """Writes an RGB picture in the format of the file's ending.

    Unlike OpenCV's own function it takes every name and says when it fails.

    Raises:
        OSError: The file cannot be written.
    """
    write_file(path, cv2.imencode(path.suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1].tobytes())


def encode_exr(channels: Mapping[str, Shaped[ndarray, "h w"]], attributes: Mapping[str, Any]) -> bytes:
    """Encodes named channels (float16, float32 or uint32) and the attributes of a header as OpenEXR, ZIP compressed."""
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    with tempfile.TemporaryDirectory() as folder:  # OpenEXR writes no file in memory, and no name that is not UTF-8
        path = Path(folder) / "picture.exr"
        OpenEXR.File(header, {name: np.ascontiguousarray(values) for name, values in channels.items()}).write(str(path))
        return path.read_bytes()


def srgb_to_linear(values: Float[ndarray, "*n"]) -> Float[ndarray, "*n"]:
    """Linear light from values as pictures store them, both 0..1. Source: IEC 61966-2-1."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(light: Float[ndarray, "*n"]) -> Float[ndarray, "*n"]:
    """The inverse of `srgb_to_linear`."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055)


def _as_seen(content: bytes, where: str) -> UInt8[ndarray, "h w 3"]:
    if is_heic(content):
        declared_size_px(content, where)
        return decode_heic(content, where)
    image = _to_8_bit(_decode(content, _AS_STORED, where), where)
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


def open_capture(video: Path) -> cv2.VideoCapture:
    """Opens a video with FFmpeg, without OpenCV's limit of 30 s for a read, which a busy machine may exceed."""
    no_limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, 0, cv2.CAP_PROP_READ_TIMEOUT_MSEC, 0]
    return cv2.VideoCapture(str(video), cv2.CAP_FFMPEG, no_limits)


def _decode(content: bytes, flags: int, where: str) -> Shaped[ndarray, "h w *c"]:
    declared_size_px(content, where)
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags) if content else None
    except cv2.error as error:
        raise InputFileError(f"{where}: expected a picture that OpenCV reads; {error.err}") from error
    if image is None:
        found = next(
            (f"a {name} that is cut off or damaged" for start, name in SIGNATURES if content.startswith(start)), ""
        )
        raise InputFileError(
            f"{where}: expected a picture (JPEG, PNG, ...), found {found or f'{len(content)} bytes that are none'}"
        )
    return image
