"""Faces with known cameras and coefficients, rendered by the NumPy rasteriser and coded in fixed point."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy import ndarray

from pix2face.geometry.camera import (
    Camera,
    HeadPose,
    Pinhole,
    WeakPerspective,
    pinhole_camera,
    rotation_of_pose,
    weak_perspective_camera,
)
from pix2face.geometry.maps import FaceMaps, fixed_point_to_maps
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.rasterise import render_maps, shows_outside
from pix2face.shards.layers import LAYERS, to_stored

SIZE_PX = 256
# The head fills the picture at this scale.
SCALE = 0.95
DISTANCE_MM = 500.0


@dataclass(frozen=True, eq=False)
class KnownFace:
    """A face, its camera and its maps."""

    camera: Camera
    principal_point_px: ndarray
    identity: ndarray
    expression: ndarray
    vertices: ndarray
    maps: FaceMaps
    surface_depth: ndarray

    def landmarks2d(self, model: MorphableModel) -> ndarray:
        return self.camera.project(self.vertices[model.landmarks["ibug68"]])

    def eye_distance_px(self, model: MorphableModel) -> float:
        """3D distance of the outer eye corners x scale."""
        landmarks = self.vertices[model.landmarks["ibug68"]]
        return float(np.linalg.norm(landmarks[36] - landmarks[45])) * SCALE

    def is_visible(self, model: MorphableModel) -> ndarray:
        """Which vertices of the face are on the nearest surface, to within the slope between neighbouring pixels."""
        pixel = np.floor(self.camera.project(self.vertices)).astype(int)
        inside = ((pixel >= 0) & (pixel < SIZE_PX)).all(axis=1)
        column, row = np.where(inside[:, None], pixel, 0).T
        surface = np.pad(np.where(np.isfinite(self.surface_depth), self.surface_depth, -np.inf), 1, mode="edge")
        deepest = np.max([surface[row + i, column + j] for i in range(3) for j in range(3)], axis=0)
        shows = np.zeros(len(self.vertices), dtype=bool)
        outside = model.is_face_triangle & shows_outside(self.camera, self.vertices, model.triangles)
        shows[model.triangles[outside]] = True
        return inside & shows & (self.camera.depth(self.vertices) < deepest + 0.2)


@lru_cache(maxsize=64)
def render_known_face(
    model: MorphableModel,
    pose: HeadPose,
    seed: int,
    *,
    perspective: bool,
    spread: float = 1.0,
    distance_mm: float = DISTANCE_MM,
    identity_seed: int | None = None,
) -> KnownFace:
    """Renders a random face, centred in a picture of 256 x 256 pixels; of one person where an identity seed says so."""
    rng = np.random.default_rng(seed)
    identity = spread * rng.normal(size=model.n_identity).clip(-2.5, 2.5)
    if identity_seed is not None:
        identity = spread * np.random.default_rng([1, identity_seed]).normal(size=model.n_identity).clip(-2.5, 2.5)
    expression = spread * rng.normal(size=model.n_expression).clip(-2.5, 2.5)
    vertices = model.vertices(identity[None], expression[None])[0]
    centre = vertices[model.is_face_vertex].mean(axis=0).astype(np.float64)
    principal_point = SIZE_PX / 2 + rng.uniform(-60, 60, 2)
    rotation = rotation_of_pose(pose)
    if perspective:
        camera = pinhole_at(rotation, centre, principal_point, distance_mm)
    else:
        camera = weak_perspective_at(rotation, centre)
    rendered = render_maps(model, vertices, camera, SIZE_PX, SIZE_PX)
    maps = FaceMaps(coded(rendered["pncc"]), coded(rendered["offset"]), rendered["mask"])
    return KnownFace(camera, principal_point, identity, expression, vertices, maps, rendered["surface_depth"])


def coded(values_mm: ndarray) -> ndarray:
    """What a shard gives back."""
    return fixed_point_to_maps(to_stored(LAYERS["pncc"], values_mm))


def weak_perspective_at(rotation: ndarray, centre: ndarray) -> Camera:
    translation = SIZE_PX / 2 - SCALE * rotation[:2] @ centre
    return weak_perspective_camera(WeakPerspective(SCALE, rotation, translation))


def pinhole_at(rotation: ndarray, centre: ndarray, principal_point: ndarray, distance_mm: float) -> Camera:
    """A camera at a distance (half a metre shows strong perspective) that shows the head as large as the others do."""
    towards = np.append((SIZE_PX / 2 - principal_point) / SCALE, distance_mm)
    return pinhole_camera(Pinhole(SCALE * distance_mm, principal_point, rotation, towards - rotation @ centre))
