"""Converts photographs and face boxes that callers pass to the types that other modules use."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Real, UInt8
from numpy import ndarray
from PIL import Image, ImageOps

from pix2face.detectors.protocol import DetectedFace
from pix2face.errors import DegenerateGeometryError, InputFileError, UsageError
from pix2face.files.images import read_photograph
from pix2face.geometry.crops import FaceBox

#: A path, a PIL image, or an RGB array of 8 bits as `pix2face.files.images.read_photograph` makes it.
GivenPhotograph = str | os.PathLike[str] | Image.Image | UInt8[ndarray, "_ _ 3"]
#: Boxes of faces, tight around the landmarks. Each is a ``FaceBox``, its left, top, right and bottom in pixels, or a
#: face of ``Pix2Face.find_faces``, whose score is kept.
GivenBoxes = Sequence[FaceBox | DetectedFace | Sequence[float] | Real[ndarray, "4"]] | Real[ndarray, "_ 4"]

SMALLEST_BOX_PX = 1.0
_WANTED = "expected a photograph: a path, a PIL image, or an array of shape (height, width, 3), RGB, uint8"
# 16-bit and floating-point modes of PIL, whose conversion to RGB cuts values off instead of scaling them.
_DEEP_MODES = ("I", "F")


def as_photograph(image: object) -> UInt8[ndarray, "h w 3"]:
    """Converts a photograph to 8-bit RGB, and applies the orientation tag of a file or a PIL image.

    Raises:
        InputFileError: The file is missing, or cannot be decoded.
        UsageError: It is neither a path, nor a PIL image of 8 bits, nor an 8-bit RGB array with any pixel.
    """
    if isinstance(image, str | os.PathLike):
        return read_photograph(Path(image))
    if isinstance(image, Image.Image):
        return _from_pil(image)
    if not isinstance(image, ndarray):
        raise UsageError(f"{_WANTED}; found an object of type {type(image).__name__}")
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or not image.size:
        raise UsageError(
            f"{_WANTED}; found {image.dtype} of shape {image.shape}; pix2face.files.images.read_photograph brings any "
            "file there"
        )
    return image


def as_photographs(images: object) -> list[UInt8[ndarray, "_ _ 3"]]:
    """Converts several photographs, each as ``as_photograph`` does and with the same errors.

    Raises:
        UsageError: It is a single photograph.
    """
    if isinstance(images, str | os.PathLike | Image.Image) or not isinstance(images, Iterable):
        raise UsageError(f"expected several photographs, such as a list, found one of type {type(images).__name__}")
    return [as_photograph(image) for image in images]


def as_boxes(boxes: object) -> list[FaceBox | DetectedFace]:
    """Converts boxes, each a ``FaceBox``, four numbers, or a detected face, which is returned unchanged.

    Raises:
        DegenerateGeometryError: A box has no extent, or is not finite.
        UsageError: Something else was given, such as a single box instead of a list.
    """
    if not isinstance(boxes, Iterable) or isinstance(boxes, str):
        raise UsageError(f"expected face boxes [(left, top, right, bottom), ...], found {boxes!r}")
    return [replace(own, box=_as_box(own.box)) if isinstance(own, DetectedFace) else _as_box(own) for own in boxes]


def _as_box(box: object) -> FaceBox:
    if not isinstance(box, FaceBox):
        try:
            left, top, right, bottom = (float(side) for side in box)  # type: ignore[attr-defined]
        except (TypeError, ValueError) as error:
            raise UsageError(f"expected face boxes [(left, top, right, bottom), ...], found {box!r} as one") from error
        box = FaceBox(left, top, right, bottom)
    is_finite = np.isfinite((*box.sides, box.turn_deg)).all()
    if not (is_finite and box.width >= 0 and box.height >= 0 and box.longer_side >= SMALLEST_BOX_PX):
        raise DegenerateGeometryError(
            f"expected a face box (left, top, right, bottom) of at least {SMALLEST_BOX_PX:g} pixel, found {box}"
        )
    return box


def _from_pil(image: Image.Image) -> UInt8[ndarray, "h w 3"]:
    if image.mode.startswith(_DEEP_MODES):
        raise UsageError(f"{_WANTED}; found a PIL image of mode {image.mode!r}; give its path instead")
    try:
        return as_photograph(np.asarray(ImageOps.exif_transpose(image).convert("RGB")))
    except (OSError, SyntaxError) as error:  # PIL decodes a file when its pixels are asked for
        raise InputFileError(f"expected a PIL image that can be decoded, found one that cannot ({error})") from error
