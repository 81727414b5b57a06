"""Landmark schemes: names, groups, mirror tables, and the ``.pts`` files that annotations come in.

Indices are 0-based (the literature counts from 1). Left and right are the subject's: point 36 is the outer corner of
the right eye, which lies on the left of a frontal photograph.

Source: Sagonas et al. 2013, 300 Faces in-the-Wild Challenge (the 68 points of Multi-PIE).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.opening import read_text_file

IBUG68: Final = "ibug68"
N_IBUG68: Final = 68
# The same points where people mark them in photographs: the jaw on the outline of the face.
IBUG68_2D: Final = "ibug68-2d"
INNER51_SCHEME: Final = "inner51"

# How many points each known scheme has. AFLW's 21 come with AFLW2000-3D (pt2d, -1 where a point is missing); the 84 are
# those of the Menpo 3D face tracking challenge (Zafeiriou et al. 2017).
SCHEMES: Final[Mapping[str, int]] = {
    IBUG68: N_IBUG68,
    IBUG68_2D: N_IBUG68,
    INNER51_SCHEME: 51,
    "aflw21": 21,
    "menpo84": 84,
}

# Each run goes along the contour as the annotation does, from the image's left to its right, eyes and mouth around.
IBUG68_GROUPS: Final[Mapping[str, tuple[int, ...]]] = {
    "jaw": tuple(range(17)),
    "right_brow": tuple(range(17, 22)),
    "left_brow": tuple(range(22, 27)),
    "nose_bridge": tuple(range(27, 31)),
    "nostrils": tuple(range(31, 36)),
    "right_eye": tuple(range(36, 42)),
    "left_eye": tuple(range(42, 48)),
    "outer_lips": tuple(range(48, 60)),
    "inner_lips": tuple(range(60, 68)),
}
CLOSED_GROUPS: Final = ("right_eye", "left_eye", "outer_lips", "inner_lips")

# The parts of a face that reports speak of.
IBUG68_PARTS: Final[Mapping[str, tuple[int, ...]]] = {
    "jaw": tuple(range(17)),
    "brows": tuple(range(17, 27)),
    "nose": tuple(range(27, 36)),
    "eyes": tuple(range(36, 48)),
    "mouth": tuple(range(48, 68)),
}

# Everything but the jaw, whose points mean different things to a photograph (outline) and to a 3D model (fixed points).
INNER51: Final = tuple(range(17, 68))

# A landmark is hidden by what is nearer by more than this. An annotated point is a place of some millimetres: the inner
# corners of the mouth lie in the fold of the lips, which cover them by 1 to 3 mm in a smile. What hides a landmark from
# people (nose, jaw, the other half of the head) is farther away.
LANDMARK_TOLERANCE_MM: Final = 3.0
OUTER_EYE_CORNERS: Final = (36, 45)
RIGHT_EYE: Final = IBUG68_GROUPS["right_eye"]
LEFT_EYE: Final = IBUG68_GROUPS["left_eye"]

# MIRROR_IBUG68[i] is the point that point i becomes when the picture is mirrored.
MIRROR_IBUG68: Final = (
    *(16, 15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0),  # jaw
    *(26, 25, 24, 23, 22, 21, 20, 19, 18, 17),  # brows
    *(27, 28, 29, 30, 35, 34, 33, 32, 31),  # nose
    *(45, 44, 43, 42, 47, 46, 39, 38, 37, 36, 41, 40),  # eyes
    *(54, 53, 52, 51, 50, 49, 48, 59, 58, 57, 56, 55),  # outer lips
    *(64, 63, 62, 61, 60, 67, 66, 65),  # inner lips
)
# The same for each scheme in which it is known.
MIRRORS: Final[Mapping[str, tuple[int, ...]]] = {
    IBUG68: MIRROR_IBUG68,
    IBUG68_2D: MIRROR_IBUG68,
    INNER51_SCHEME: tuple(INNER51.index(MIRROR_IBUG68[point]) for point in INNER51),
}

# WFLW98_OF_IBUG68[i] is the point of WFLW (Wu et al. 2018) that is annotated as point i of iBUG-68: every second one of
# the jaw, the upper edges of the brows, and eyes without the middles of the lids and the pupils.
N_WFLW98: Final = 98
WFLW98_OF_IBUG68: Final = (
    *range(0, 33, 2),  # jaw
    *(*range(33, 38), *range(42, 47)),  # brows
    *range(51, 60),  # nose
    *(60, 61, 63, 64, 65, 67),  # right eye
    *(68, 69, 71, 72, 73, 75),  # left eye
    *range(76, 96),  # lips
)

# Annotation tools count pixels from 1 with integers at the centres: their 1.0 is our 0.5.
ONE_BASED_TO_CENTRES_PX: Final = -0.5
# 68 points with as many digits as a double has take 4 KB.
LARGEST_PTS_BYTES: Final = 1 << 20


def read_pts(path: Path, n_landmarks: int = N_IBUG68) -> Float64[ndarray, "n 2"]:
    """Reads a ``.pts`` annotation into the project's pixel frame (x right, y down, centres at +0.5).

    Args:
        path: A text file: ``version: 1``, ``n_points: 68``, ``{``, one ``x y`` a line (1-based pixels), ``}``.
        n_landmarks: The number of points of the scheme. Where it is 68, the 98 points of WFLW are read, too, as the 68
            among them.

    Raises:
        InputFileError: The file is missing, cut off, of another format or scheme, or holds values that are not finite.
    """
    text = read_text_file(path, "the text of a .pts annotation", LARGEST_PTS_BYTES, "ascii")
    header, brace, body = text.partition("{")
    if not brace or "n_points" not in header:
        raise InputFileError(f"expected 'version', 'n_points' and '{{' at the start of {path}, found {text[:40]!r}")
    if "}" not in body:
        raise InputFileError(f"expected {path} to end in '}}', found no end: the file is cut off; download it again")
    words = body.partition("}")[0].split()
    declared = header.split("n_points")[1].strip(" :\r\n\t")
    is_wflw = n_landmarks == N_IBUG68 and declared == str(N_WFLW98) and len(words) == 2 * N_WFLW98
    if not is_wflw and (declared != str(n_landmarks) or len(words) != 2 * n_landmarks):
        raise InputFileError(
            f"expected {n_landmarks} points in {path}, found n_points: {declared} and {len(words) / 2:g} points"
        )
    try:
        points = np.array(words, dtype=np.float64).reshape(-1, 2)
    except ValueError as error:
        raise InputFileError(f"expected numbers in {path}: {error}") from error
    if is_wflw:
        points = points[list(WFLW98_OF_IBUG68)]
    return mark_missing(points) + ONE_BASED_TO_CENTRES_PX


def mark_missing(points: Float64[ndarray, "n d"]) -> Float64[ndarray, "n d"]:
    """Points of a file with NaN in place of those that mean "no point here".

    Tools write -1 -1, 0 0 or NaN for a point that was not annotated. All of these have no positive x or y, and no point
    of a photograph does. The coordinates are those of the file, x and y first.
    """
    is_missing = ~(np.isfinite(points).all(axis=1) & (points[:, :2] > 0).any(axis=1))
    return np.where(is_missing[:, None], np.nan, points)
