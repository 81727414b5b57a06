"""Pictures in and out of files: what OpenCV leaves open is settled here (RGB, 8 bit, orientation, errors)."""

import stat
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Shaped, UInt8
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.picture_head import check_declared_size

PHOTOGRAPH_QUALITY = 95
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff")


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
        InputFileError: There is no such file, it cannot be read, or it is none that ends (a device, a pipe).
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


def encode_image(image: UInt8[ndarray, "h w 3"]) -> bytes:
    """Encodes an RGB picture without loss (PNG)."""
    return bytes(cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1])


def encode_photograph(image: UInt8[ndarray, "h w 3"]) -> bytes:
    """Encodes an RGB picture as photographs come (JPEG, quality 95): a fifth of PNG, in a tenth of its time.

    docs/explanation/storage.md has the figures. Colour has half the resolution of brightness, as in most photographs.
    """
    flags = [cv2.IMWRITE_JPEG_QUALITY, PHOTOGRAPH_QUALITY]
    flags += [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420]
    return bytes(cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), flags)[1])


def _to_8_bit(image: Shaped[ndarray, "h w 3"]) -> UInt8[ndarray, "h w 3"]:
    if image.dtype == np.uint16:
        return (image >> 8).astype(np.uint8)
    if image.dtype != np.uint8:
        return (np.nan_to_num(np.clip(image, 0, 1)) * 255).astype(np.uint8)
    return image


def _decode(content: bytes, flags: int, where: str) -> Shaped[ndarray, "h w 3"]:
    check_declared_size(content, where)
    try:
        image = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags) if content else None
    except cv2.error as error:  # a head that declares more pixels than OpenCV takes
        raise InputFileError(f"{where}: expected a picture of a size that fits into memory; {error.err}") from error
    if image is None:
        raise InputFileError(f"{where}: expected a picture (JPEG, PNG, ...), found {len(content)} bytes that are none")
    return image
