"""Rigid alignment of point sets: in closed form for known correspondences, otherwise by iterated closest points.

Source: Umeyama 1991, Least-squares estimation of transformation parameters; Besl and McKay 1992 and Chen and Medioni
1992 (closest points), trimmed as in Chetverikov et al. 2005.
"""

from dataclasses import dataclass
from itertools import product
from typing import final

import numpy as np
from jaxtyping import Float, Float64, Int32, Int64
from numpy import ndarray
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from pix2face.errors import DegenerateGeometryError

MIN_POINTS = 3
# Partners beyond this share of the closest ones are taken for places that the other surface does not have.
KEPT_SHARE = 0.8
_COARSE_POINTS, _COARSE_STEPS = 300, 20
_FINE_POINTS, _FINE_STEPS = 1000, 30
# A finer target does not make the search better, only slower.
_TARGET_POINTS = 12000
_FINALISTS = 14
_CONVERGED_MM = 1e-3
# A normal that differs by 60 degrees counts as much as this distance.
_DIRECTION_MM = 20.0
# How much the distance to a partner counts beside the distance to its plane.
_POINT_WEIGHT = 0.1


@final
@dataclass(frozen=True, eq=False)
class RigidTransform:
    """y = rotation @ x + translation, in mm; the rotation has determinant +1."""

    rotation: Float64[ndarray, "3 3"]
    translation: Float64[ndarray, "3"]

    def apply(self, points: Float[ndarray, "*n 3"]) -> Float64[ndarray, "*n 3"]:
        """Moves points (mm)."""
        return np.asarray(points @ self.rotation.T + self.translation, dtype=np.float64)

    def turn(self, directions: Float[ndarray, "*n 3"]) -> Float64[ndarray, "*n 3"]:
        """Rotates displacements (mm)."""
        return np.asarray(directions @ self.rotation.T, dtype=np.float64)

    @property
    def matrix(self) -> Float64[ndarray, "4 4"]:
        """The homogeneous matrix."""
        out = np.eye(4)
        out[:3, :3], out[:3, 3] = self.rotation, self.translation
        return out


def fit_rigid(source: Float[ndarray, "n 3"], target: Float[ndarray, "n 3"]) -> tuple[RigidTransform, float]:
    """Minimises sum |R x + t - y|^2 over rotations and translations.

    The second result is the scale that a similarity would have had in addition; it is not applied.

    Raises:
        DegenerateGeometryError: Fewer than 3 points, or all on one line.
    """
    if len(source) < MIN_POINTS:
        raise DegenerateGeometryError(f"expected at least {MIN_POINTS} pairs of points, found {len(source)}")
    from_centre, to_centre = source.mean(axis=0, dtype=np.float64), target.mean(axis=0, dtype=np.float64)
    centred, aimed = source - from_centre, target - to_centre
    u, spread, vt = np.linalg.svd(aimed.T @ centred)
    if not spread[1] > 1e-9 * spread[0]:
        raise DegenerateGeometryError("expected points that span a plane at least, found them on a line")
    signs = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * signs) @ vt
    scale = float((spread * signs).sum() / (centred**2).sum())
    return RigidTransform(rotation, to_centre - rotation @ from_centre), scale


@final
@dataclass(frozen=True, eq=False)
class Surface:
    """Points of a surface (mm) with their normals."""

    points: Float64[ndarray, "n 3"]
    normals: Float64[ndarray, "n 3"]  # unit length, outward

    def moved(self, transform: RigidTransform) -> "Surface":
        """The surface moved and turned."""
        return Surface(transform.apply(self.points), transform.turn(self.normals))

    def chosen(self, index: ndarray) -> "Surface":
        """Some of the points."""
        return Surface(self.points[index], self.normals[index])


@final
class SurfaceIndex:
    """Finds the closest point of a surface that faces the same way: the inside of a mouth is no lip."""

    def __init__(self, surface: Surface) -> None:
        self.surface = surface
        self._tree = KDTree(_with_direction(surface))

    def closest(self, surface: Surface) -> tuple[Float64[ndarray, " n"], Int64[ndarray, " n"]]:
        """Distance (mm) to the partner of each point, and which point that is."""
        partners = np.asarray(self._tree.query(_with_direction(surface))[1], dtype=np.int64)
        return np.linalg.norm(self.surface.points[partners] - surface.points, axis=1), partners


def surface_of(vertices: Float[ndarray, "v 3"], polygons: Int32[ndarray, "p 4"]) -> Surface:
    """A mesh with vertex normals; they are turned outward as seen from the middle of its box.

    Source: Max 1999 for weights (here by area).
    """
    points = vertices.astype(np.float64)
    centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
    corners = points[polygons[:, :3]] - centre
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    across *= np.sign((across * corners.mean(axis=1)).sum()) or 1.0
    normals = np.zeros_like(points)
    for corner in range(4):
        is_corner = polygons[:, corner] >= 0
        np.add.at(normals, polygons[is_corner, corner], across[is_corner])
    return Surface(points, normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12))


def align_surfaces(
    source: Surface, target: Surface, anchors: Float64[ndarray, "a 3"]
) -> tuple[RigidTransform, Float64[ndarray, " n"]]:
    """Brings a dense surface onto another of which it is a part, from any pose along the axes.

    Nearly all of the source should have a counterpart; the target may extend further (neck, back of the head, teeth).
    One of the anchors, which are points in the source's frame (mm), should lie near the middle of the target's box.

    Returns the best transform of source onto target, and each source point's distance to its partner (mm).
    """
    rng, n_points = np.random.default_rng(0), len(source.points)
    index = SurfaceIndex(target.chosen(rng.permutation(len(target.points))[:_TARGET_POINTS]))
    coarse = source.chosen(rng.permutation(n_points)[:_COARSE_POINTS])
    fine = source.chosen(rng.permutation(n_points)[:_FINE_POINTS])
    centre = 0.5 * (target.points.min(axis=0) + target.points.max(axis=0))
    frames = np.rint(Rotation.create_group("O").as_matrix())  # the 24 ways to name the axes of a right-handed frame
    starts = [RigidTransform(axes, centre - axes @ anchor) for axes, anchor in product(frames, anchors)]
    found = [_iterate(coarse, index, start, _COARSE_STEPS) for start in starts]
    found.sort(key=lambda result: result[1])
    # Nearly all models name their axes alike: that guess is always followed to its end.
    likely = [RigidTransform(np.eye(3), centre - anchor) for anchor in anchors]
    finalists = likely + [transform for transform, _ in found[:_FINALISTS]]
    best = min((_iterate(fine, index, start, _FINE_STEPS) for start in finalists), key=lambda result: result[1])[0]
    return best, SurfaceIndex(target).closest(source.moved(best))[0]


def trimmed_rms(distances: Float64[ndarray, " n"]) -> float:
    """Root mean square of the closest part of some distances."""
    kept = np.sort(distances)[: max(1, int(KEPT_SHARE * len(distances)))]
    return float(np.sqrt((kept**2).mean()))


def _iterate(source: Surface, index: SurfaceIndex, start: RigidTransform, steps: int) -> tuple[RigidTransform, float]:
    """Pairs each point with the closest, keeps the best pairs, moves along the target's normals, and repeats."""
    transform, best, residual = start, start, np.inf
    n_kept = max(MIN_POINTS, int(KEPT_SHARE * len(source.points)))
    for _ in range(steps):
        moved = source.moved(transform)
        distances, partners = index.closest(moved)
        kept = np.argpartition(distances, n_kept - 1)[:n_kept]
        found = float(np.sqrt((distances[kept] ** 2).mean()))
        if found < residual:
            best, residual = transform, found
        step = _step(moved.points[kept], index.surface.chosen(partners[kept]))
        transform = RigidTransform(step.rotation @ transform.rotation, step.apply(transform.translation))
        if np.abs(step.apply(moved.points) - moved.points).max() < _CONVERGED_MM:
            break
    return best, residual


def _step(points: Float64[ndarray, "n 3"], target: Surface) -> RigidTransform:
    """A small motion that lowers the distance to the planes of the partners and, a little, to the partners themselves.

    Source: Chen and Medioni 1992, Object modelling by registration of multiple range images.
    """
    centre = points.mean(axis=0)
    arms, gap = points - centre, target.points - points
    # (w x arm + t - gap) . n for the planes; all three coordinates of it, weighted down, for the points.
    along = np.hstack([np.cross(arms, target.normals), target.normals])
    crossed = np.cross(np.eye(3), arms[:, None]).transpose(0, 2, 1)
    apart = np.concatenate([crossed, np.broadcast_to(np.eye(3), crossed.shape)], axis=2).reshape(-1, 6)
    normal_matrix = along.T @ along + _POINT_WEIGHT * apart.T @ apart
    wanted = along.T @ (gap * target.normals).sum(axis=1) + _POINT_WEIGHT * apart.T @ gap.ravel()
    motion = np.linalg.solve(normal_matrix + 1e-9 * np.trace(normal_matrix) * np.eye(6), wanted)
    rotation = Rotation.from_rotvec(motion[:3]).as_matrix()
    return RigidTransform(rotation, centre + motion[3:] - rotation @ centre)


def _with_direction(surface: Surface) -> Float64[ndarray, "n 6"]:
    return np.hstack([surface.points, _DIRECTION_MM * surface.normals])
