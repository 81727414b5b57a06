"""What ``Pix2Face`` is given, looked at before anything is computed: users have no type checker at run time."""

import numpy as np
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.geometry.crops import FaceBox

SMALLEST_BOX_PX = 1.0


def check_photograph(image: ndarray) -> None:
    """Makes sure that an array is a photograph.

    Raises:
        UsageError: It is not 8-bit RGB, or empty.
    """
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or not image.size:
        raise UsageError(
            f"expected a photograph of shape (height, width, 3), RGB, uint8, found {image.dtype} of shape "
            f"{image.shape}; pix2face.files.images.read_photograph brings any file there"
        )


def check_box(box: FaceBox) -> None:
    """Makes sure that a box can hold a face.

    Raises:
        DegenerateGeometryError: It has no extent, or is not finite.
    """
    sides = np.array([box.left, box.top, box.right, box.bottom])
    if not (np.isfinite(sides).all() and box.width >= 0 and box.height >= 0 and box.longer_side >= SMALLEST_BOX_PX):
        raise DegenerateGeometryError(
            f"expected a face box (left, top, right, bottom) of at least {SMALLEST_BOX_PX:g} pixel, found {box}"
        )
