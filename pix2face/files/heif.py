"""HEIC photographs, as phones write them; the extra ``heic`` reads them (package pillow-heif)."""

import importlib
from io import BytesIO
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.errors import InputFileError

HOW_TO_INSTALL = "pip install 'pix2face[heic]'"
# Brands of ISO/IEC 23008-12 whose pictures are coded as HEVC. A file of a general brand names one of them further on.
_BRANDS = (b"heic", b"heix", b"hevc", b"hevx", b"heim", b"heis", b"hevm", b"hevs")
_GENERAL_BRANDS = (b"mif1", b"msf1")


def is_heic(head: bytes) -> bool:
    """Whether a file that begins like this is a HEIC picture."""
    if head[4:8] != b"ftyp":
        return False
    others = head[16 : min(int.from_bytes(head[:4]), 256)]
    return head[8:12] in _BRANDS or (head[8:12] in _GENERAL_BRANDS and any(brand in others for brand in _BRANDS))


def decode_heic(content: bytes, where: str) -> UInt8[ndarray, "h w 3"]:
    """Decodes a HEIC picture to RGB, as people see it: the file's own rotation is applied.

    Raises:
        InputFileError: It cannot be decoded, or the package that does it is not installed.
    """
    try:
        return np.asarray(_open(content, where).to_pillow().convert("RGB"))
    except (ValueError, RuntimeError, OSError, EOFError, SyntaxError) as error:
        raise InputFileError(f"{where}: expected a HEIC picture, found one that cannot be decoded ({error})") from error


def heic_size_px(content: bytes, where: str) -> tuple[int, int]:
    """Height and width of a HEIC picture as people see it; errors as ``decode_heic``."""
    width, height = _open(content, where).size  # upright: pillow-heif applies the rotation
    return height, width


def _open(content: bytes, where: str) -> Any:
    try:
        pillow_heif = importlib.import_module("pillow_heif")
    except ImportError as error:
        raise InputFileError(
            f"{where}: expected a picture (JPEG, PNG, ...), found HEIC, which needs an extra package: {HOW_TO_INSTALL}"
        ) from error
    try:
        return pillow_heif.open_heif(BytesIO(content), convert_hdr_to_8bit=True)
    except (ValueError, RuntimeError, OSError, EOFError, SyntaxError) as error:
        raise InputFileError(f"{where}: expected a HEIC picture, found one with a damaged head ({error})") from error
