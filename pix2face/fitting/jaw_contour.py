"""Jaw points that slide: in a photograph the jaw is annotated where the face ends, not at fixed points of the skin.

As a head turns, the outline wanders over the far cheek towards the nose. Each jaw landmark therefore has a curve on the
surface, from itself towards the base of the nose, in the plane through both that holds the viewing axis of the frontal
face; in a given pose its match is the point of the curve that lies farthest out in the picture. On the near side that
is the landmark itself.

Source: Zhu et al. 2015, High-Fidelity Pose and Expression Normalization (landmark marching), with planes through the
base of the nose instead of hand-drawn horizontal lines, so that any model with the 68 landmarks has them.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float64, Int
from numpy import ndarray

from pix2face.geometry.camera import Camera
from pix2face.geometry.landmarks import IBUG68, IBUG68_2D, IBUG68_PARTS
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.surface_attributes import vertex_normals

JAW = IBUG68_PARTS["jaw"]
NOSE_BASE = 33
# How far along its curve a jaw point may wander, as a share of the way to the base of the nose.
LONGEST_WAY = 0.5
# Half the width of the strip of vertices that stands for a curve, in spacings of the mesh, and how far back the strip
# may reach behind its landmark.
STRIP_SPACINGS = 1.0
BEHIND_MM = 1.0
# A plane that holds the viewing axis cuts the surface as a curve only where the skin does not face sideways within it.
LEAST_FACING = -0.2


@final
@dataclass(frozen=True, eq=False)
class JawContour:
    """The curves of a model, as vertices with their bases."""

    owner: Int[ndarray, " p"]  # for each vertex the jaw landmark (0 to 16) whose curve it lies on
    # For each jaw landmark the direction away from the base of the nose, frontal face (x, y).
    outward: Float64[ndarray, "17 2"]
    mean: Float64[ndarray, "p 3"]  # mm
    basis: Float64[ndarray, "c p 3"]  # mm per standard deviation, identity before expression

    @classmethod
    def of(cls, model: MorphableModel) -> "JawContour":
        """Finds the curves on the mean face. Each holds at least its landmark, of ``ibug68-2d`` if the model has it."""
        vertices = model.landmarks.get(IBUG68_2D, model.landmarks[IBUG68])
        mean = model.mean.astype(np.float64)
        allowed = model.is_face_vertex & (vertex_normals(mean, model.triangles)[:, 2] > LEAST_FACING)
        half_width = STRIP_SPACINGS * _spacing(mean, model.triangles[model.is_face_triangle])
        members, owners, outward = [], [], []
        for jaw in JAW:
            landmark, base = mean[vertices[jaw]], mean[vertices[NOSE_BASE]]
            direction = (landmark - base)[:2] / np.linalg.norm((landmark - base)[:2])
            found = np.flatnonzero(allowed & _is_on_strip(mean, landmark, base, direction, half_width))
            found = np.union1d(found, [vertices[jaw]])
            members.append(found)
            owners.append(np.full(len(found), jaw))
            outward.append(direction)
        chosen = np.concatenate(members)
        # `take` returns arrays in C order, as in ``LandmarkModel.of``.
        basis = np.concatenate([each.take(chosen, axis=1) for each in (model.identity_basis, model.expression_basis)])
        return cls(np.concatenate(owners), np.stack(outward), mean[chosen], basis.astype(np.float64))

    def outermost(self, camera: Camera, coefficients: Float64[ndarray, " c"]) -> Int[ndarray, "17"]:
        """For each jaw landmark the vertex of its curve (an index into this table) that a camera sees farthest out."""
        points = self.mean + np.tensordot(coefficients, self.basis, axes=1)
        pixels = camera.project(points)
        outward = self.outward @ _upright_axes(camera)
        reach = (pixels * outward[self.owner]).sum(axis=1)
        order = np.lexsort([reach, self.owner])
        last_of_owner = np.searchsorted(self.owner[order], np.arange(len(JAW)), side="right") - 1
        return order[last_of_owner]

    def outermost_points(self, camera: Camera, coefficients: Float64[ndarray, " c"]) -> Float64[ndarray, "17 3"]:
        """The places of ``outermost`` on the face of these coefficients, mm, model frame."""
        outermost = self.outermost(camera, coefficients)
        return self.mean[outermost] + np.tensordot(coefficients, self.basis[:, outermost], axes=1)


def _upright_axes(camera: Camera) -> Float64[ndarray, "2 2"]:
    """Where x and y of the frontal face point in the picture: turned by roll alone, whatever yaw and pitch are."""
    up = camera.matrix[:2, 1] / np.linalg.norm(camera.matrix[:2, 1])
    # In the picture y points down: x is the up axis turned clockwise as seen, (0, -1) -> (1, 0).
    return np.array([[-up[1], up[0]], up])


def _is_on_strip(
    points: Float64[ndarray, "v 3"],
    landmark: Float64[ndarray, "3"],
    base: Float64[ndarray, "3"],
    direction: Float64[ndarray, "2"],
    half_width: float,
) -> Bool[ndarray, " v"]:
    """Whether points lie near the plane of a curve, between its landmark and the end of its way."""
    offset = points[:, :2] - base[:2]
    along, across = offset @ direction, offset @ np.array([-direction[1], direction[0]])
    reach = float((landmark - base)[:2] @ direction)
    is_between = (along >= (1 - LONGEST_WAY) * reach) & (along <= reach)
    return np.asarray(is_between & (np.abs(across) <= half_width) & (points[:, 2] >= landmark[2] - BEHIND_MM))


def _spacing(points: Float64[ndarray, "v 3"], triangles: Int[ndarray, "t 3"]) -> float:
    """Typical length of an edge."""
    return float(np.median(np.linalg.norm(points[triangles] - points[np.roll(triangles, 1, axis=1)], axis=2)))
