"""Bends a modelled hairdo into many: wider, shorter, combed aside, blown, tucked under a hat.

All of it happens around the model's mean, before the hairdo follows a head.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float32, Int32
from numpy import ndarray

from datagen.appearance.hair.bound_meshes import BoundMesh
from datagen.appearance.hair.parting import Parting, comb_aside
from datagen.appearance.hair.styles import Hairdo

EARS_MM = 0.0  # height of the ears' middle
# Under a hat: strands above its rim are left out but for this strip, mm; at the rim they lie this close to the skin.
STRIP_MM, AT_RIM_MM = 12.0, 3.0


@final
@dataclass(frozen=True)
class CrownPlane:
    """Above it a hat hides hair.

    Attributes:
        point: On the rim of the hat, mm, around the model's mean.
        normal: Out of the top of the hat, unit.
    """

    point: tuple[float, float, float]
    normal: tuple[float, float, float]


def shaped(mesh: BoundMesh, parting: Parting, hairdo: Hairdo, crown: CrownPlane | None) -> Float32[ndarray, "p 3"]:
    """Where the points of a mesh are around the mean, once it is worn in this way."""
    points = mesh.mean - mesh.feet
    height = np.linalg.norm(points, axis=1)
    # What hangs far from the head keeps its shape.
    points *= (1 + (hairdo.volume - 1) * np.clip((140 - height) / 80, 0, 1))[:, None]
    if crown is not None:
        points *= _tucked(mesh, crown, height)[:, None]
    points += mesh.feet
    points[:, 1] = np.where(points[:, 1] < EARS_MM, EARS_MM + (points[:, 1] - EARS_MM) * hairdo.length, points[:, 1])
    if hairdo.aside > 0:
        comb_aside(points, parting, hairdo.aside)
    points[:, 0] += hairdo.sway_mm * np.minimum(height / 100, 1.5) ** 1.5
    return points


def uncovered(mesh: BoundMesh, points: Float32[ndarray, "p 3"], crown: CrownPlane | None) -> Int32[ndarray, "t 3"]:
    """Triangles that a hat leaves to be seen: those that lie below it as modelled and as worn (``points``)."""
    if crown is None:
        return mesh.triangles
    is_seen: Bool[ndarray, " v"] = (np.maximum(_above(mesh.mean, crown), _above(points, crown)) < STRIP_MM)[
        mesh.point_of_vertex
    ]
    return np.ascontiguousarray(mesh.triangles[is_seen[mesh.triangles].all(axis=1)])


def _above(points: Float32[ndarray, "p 3"], crown: CrownPlane) -> Float32[ndarray, " p"]:
    return (points - np.array(crown.point, np.float32)) @ np.array(crown.normal, np.float32)


def _tucked(mesh: BoundMesh, crown: CrownPlane, height: Float32[ndarray, " p"]) -> Float32[ndarray, " p"]:
    """Factor on the distance from the skin: small at the rim, 1 some way below."""
    most = AT_RIM_MM + 0.8 * np.maximum(-_above(mesh.mean, crown), 0)
    return np.minimum(1, most / np.maximum(height, 1e-3))
