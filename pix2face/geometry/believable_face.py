"""Whether a posed face with coefficients can be that of a photograph: what wrong annotations leave behind.

A face that was fitted to points in another order, to points that mean "missing", or to those of another picture is
still a face in the eyes of a renderer. But it looks away from the camera, has coefficients that nobody has, or lies
outside of its picture. Faces that were drawn at random may be so on purpose.

The limits were chosen on 400 faces of AFLW2000-3D, 30 of 300-W and 43 of dlib's examples, with three models
(``python -m tests.benchmarks.good_faces`` prints the distributions).
"""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from pix2face.geometry.camera import Camera, nearest_weak_perspective


@final
@dataclass(frozen=True)
class FaceLimits:
    """How far a face may go."""

    facing_deg: float  # angle between the direction of the face and that to the camera
    # Mahalanobis distance from the mean face, beyond that of a random face (the root of their number)
    coefficients: float
    outside: float  # share of the landmarks outside of the picture


# Points that were set by hand: of an outline beyond 90 degrees nobody sees the far half. The worst face has 89°, and
# profiles in mirrored order begin at 102°.
SET_BY_HAND = FaceLimits(facing_deg=100, coefficients=15, outside=1 / 3)
# Points that were projected from a model: the worst face has 98°. A model of 10 components reaches 12.3 with such
# faces, the built-in model 3.6; wrong points begin at 15.
PROJECTED = FaceLimits(facing_deg=120, coefficients=15, outside=1 / 3)
# Faces from elsewhere, such as coefficients of files, and those transferred between models (up to 22).
GIVEN = FaceLimits(facing_deg=120, coefficients=25, outside=1 / 2)
# Crops of them that were jittered: up to three quarters of a face are outside on purpose.
JITTERED = FaceLimits(facing_deg=120, coefficients=25, outside=1)


@final
@dataclass(frozen=True)
class FaceMeasures:
    """What of a face tells whether it can be true."""

    facing_deg: float  # 0 looks into the camera, 90 is a profile, 180 is the back of the head
    coefficients: float  # Mahalanobis distance from the mean face, less the root of the number of coefficients
    largest_coefficient: float  # standard deviations
    outside: float  # share of the landmarks outside of the picture; 0 where there are none

    def problems(self, limits: FaceLimits) -> list[str]:
        """What cannot be true, in words; empty where nothing is wrong."""
        found = []
        if not self.facing_deg <= limits.facing_deg:
            found.append(
                f"the face looks {self.facing_deg:.0f}° away from the camera (at most {limits.facing_deg:.0f}°)"
            )
        if not self.coefficients <= limits.coefficients:
            found.append(
                f"nobody has its coefficients (up to {self.largest_coefficient:.1f} standard deviations; "
                f"{self.coefficients:.0f} farther from the mean face than a random face, at most "
                f"{limits.coefficients:.0f})"
            )
        if not self.outside <= limits.outside:
            found.append(
                f"{100 * self.outside:.0f} % of the landmarks are outside of the picture (at most "
                f"{100 * limits.outside:.0f} %)"
            )
        return found


def measure_face(
    camera: Camera,
    coefficients: Float[ndarray, " c"],
    landmarks2d: Float[ndarray, "m 2"],
    size_px: tuple[int, int],
) -> FaceMeasures:
    """Measures a face by its camera, coefficients (standard deviations) and landmarks in a picture (height, width)."""
    values = coefficients.astype(np.float64)
    is_inside = np.asarray((landmarks2d >= 0) & (landmarks2d <= size_px[::-1])).all(axis=1)
    return FaceMeasures(
        facing_deg=facing_deg(camera),
        coefficients=float(np.linalg.norm(values)) - math.sqrt(len(values)),
        largest_coefficient=float(np.abs(values).max(initial=0)),
        outside=np.count_nonzero(~is_inside) / max(len(landmarks2d), 1),
    )


def facing_deg(camera: Camera) -> float:
    """The angle between the direction of a face and that to the camera, 0 to 180."""
    # In camera space z points away from the camera, in the model frame out of the face.
    cosine = -float(nearest_weak_perspective(camera).rotation[2, 2])
    return math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))
