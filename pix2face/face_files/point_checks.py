"""Whether annotated points can belong to their picture.

Wrong points seldom look wrong to a fit: a face of half the size or outside of the picture is still a face. The limits
were chosen on 400 faces of AFLW2000-3D, 30 of 300-W and 43 of dlib's examples, none of which they refuse
(``python -m tests.benchmarks.good_faces`` prints the distributions).
"""

import math
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.picture_head import ON_ITS_SIDE
from pix2face.geometry.landmarks import SCHEMES

# Some tools count pixels from 0 where the format counts from 1, and points on the border are set by hand.
MARGIN_PX = 1.0
# Of the faces above, the worst has 1 of 68 points outside. Faces that the border cuts may have more.
MOST_OUTSIDE = 1 / 3
# Nobody can set 68 points on a face of 8 pixels. Normalised coordinates make faces of one pixel or two.
SMALLEST_FACE_PX = 8.0
# Fewer points do not tell the shape of a face. AFLW's 21 points stand only where they are seen, in profiles less than
# half of them.
LEAST_PRESENT = 1 / 2
LEAST_OF_SEEN = 2


def are_outside(landmarks2d: Float64[ndarray, "m 2"], size_px: tuple[int, int]) -> Bool[ndarray, " m"]:
    """Which points lie outside a picture of this height and width; missing ones (NaN) do not."""
    beyond = [size_px[1] + MARGIN_PX, size_px[0] + MARGIN_PX]
    return np.asarray(((landmarks2d < -MARGIN_PX) | (landmarks2d > beyond)).any(axis=1))


def check_points(
    landmarks2d: Float64[ndarray, "m 2"], size_px: tuple[int, int], orientation: int, where: Path
) -> Bool[ndarray, " m"]:
    """Checks that points can be those of a face in a picture, and returns which of them lie in it.

    Points (NaN where missing) and size (height, width) are those of the picture as people see it; the orientation is
    the tag of its file. ``where`` is the file of the points, for messages.

    Raises:
        InputFileError: Too many points are missing or outside, or all of them lie within a few pixels.
    """
    present = np.isfinite(landmarks2d).all(axis=1)
    n, n_all = int(present.sum()), len(landmarks2d)
    least = LEAST_OF_SEEN if n_all == SCHEMES["aflw21"] else math.ceil(LEAST_PRESENT * n_all)
    if n < least:
        raise InputFileError(f"{where}: expected at least {least} of the {n_all} points of a face, found {n}")
    extent = np.ptp(landmarks2d[present], axis=0)
    if not extent.max() >= SMALLEST_FACE_PX:
        raise InputFileError(
            f"{where}: expected points of a face in pixels, found all of them within {extent[0]:.3g} x {extent[1]:.3g} "
            "pixels; were they divided by the size of the picture?"
        )
    outside = are_outside(landmarks2d, size_px)
    if outside.sum() > MOST_OUTSIDE * n:
        raise InputFileError(
            f"{where}: expected points in its picture of {size_px[1]} x {size_px[0]} pixels, found {outside.sum()} of "
            f"{n} outside; {_likely_cause(landmarks2d, size_px, orientation)}"
        )
    return np.asarray(present & ~outside)


def _likely_cause(landmarks2d: Float64[ndarray, "m 2"], size_px: tuple[int, int], orientation: int) -> str:
    n_present = np.isfinite(landmarks2d).all(axis=1).sum()
    if orientation in ON_ITS_SIDE and not are_outside(landmarks2d, size_px[::-1]).any():
        return (
            f"its picture has the orientation tag {orientation}, and points must refer to the upright picture that "
            "viewers show: do these refer to the stored pixels?"
        )
    if are_outside(landmarks2d[:, ::-1], size_px).sum() <= MOST_OUTSIDE * n_present:
        return "are x and y swapped?"
    return "was the picture resized or cropped after annotation?"
