"""Shapes of which accessories consist: sheets, tubes, boxes, ellipsoids, and solids of revolution."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import final

import numpy as np
from jaxtyping import Float, Float32, Float64, Int32
from numpy import ndarray

from datagen.appearance.scene import Material, SceneMesh
from datagen.random_streams import Triple


@final
@dataclass(frozen=True, eq=False)
class Solid:
    """A triangle mesh without a material."""

    vertices: Float32[ndarray, "v 3"]  # mm
    triangles: Int32[ndarray, "t 3"]
    uv: Float32[ndarray, "v 2"]  # texture coordinates in repeats of the texture
    normals: Float32[ndarray, "v 3"]  # unit, outward

    def placed(self, rotation: Float[ndarray, "3 3"], place: Float[ndarray, "3"], scale: float = 1.0) -> "Solid":
        """Returns the solid scaled, then rotated, then moved."""
        turn = np.asarray(rotation, dtype=np.float32)
        vertices = (self.vertices * np.float32(scale)) @ turn.T + np.asarray(place, dtype=np.float32)
        return Solid(vertices, self.triangles, self.uv, self.normals @ turn.T)

    def moved(self, place: Float[ndarray, "3"], scale: float = 1.0) -> "Solid":
        """Returns the solid scaled, then moved."""
        return self.placed(np.eye(3), place, scale)

    def mirrored(self) -> "Solid":
        """Returns the mirror image, on the other side of the head."""
        flip = np.array([-1, 1, 1], dtype=np.float32)
        return Solid(self.vertices * flip, self.triangles[:, ::-1].copy(), self.uv, self.normals * flip)


def solid(
    vertices: Float[ndarray, "v 3"],
    triangles: Int32[ndarray, "t 3"],
    uv: Float[ndarray, "v 2"],
    normals: Float[ndarray, "v 3"],
) -> Solid:
    """Makes a solid from arrays of any precision."""
    place, uv = (np.ascontiguousarray(each, dtype=np.float32) for each in (vertices, uv))
    return Solid(place, triangles, uv, np.asarray(normals, dtype=np.float32))


def unit(vectors: Float[ndarray, "*n 3"]) -> Float32[ndarray, "*n 3"]:
    """Normalises vectors; zero vectors become (0, 0, 1)."""
    found = np.array(vectors, dtype=np.float32)
    size = np.sqrt(np.einsum("...i,...i->...", found, found))
    nowhere = size < 1e-9
    if nowhere.any():
        found[nowhere] = [0, 0, 1]
        size = np.where(nowhere, np.float32(1), size)
    found /= size[..., None]
    return found


def cross(a: Float[ndarray, "*#n 3"], b: Float[ndarray, "*#n 3"]) -> Float[ndarray, "*_ 3"]:
    """Returns the cross product, several times as fast as `numpy.cross`."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


@lru_cache(maxsize=256)
def grid_triangles(rows: int, columns: int) -> Int32[ndarray, "t 3"]:
    """Returns the triangles of a grid of vertices, row by row, with row direction x column direction outward."""
    first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1)
    quads = np.stack([first, first + columns, first + columns + 1, first + 1], axis=1)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]], axis=1).reshape(-1, 3).astype(np.int32)
    triangles.setflags(write=False)
    return triangles


@lru_cache(maxsize=256)
def grid_uv(rows: int, columns: int) -> Float32[ndarray, "n 2"]:
    """Returns texture coordinates of a grid that shows the texture once."""
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    uv = np.stack([u, v], axis=-1).reshape(-1, 2).astype(np.float32)
    uv.setflags(write=False)
    return uv


@lru_cache(maxsize=64)
def _section(sides: int, squareness: float) -> Float64[ndarray, "c 2"]:
    """Returns the cross section of a tube, (sideways, upward)."""
    angle = np.linspace(0, 2 * np.pi, sides + 1) + np.pi / sides
    across = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across /= np.abs(across).max(axis=1, keepdims=True) ** squareness
    across.setflags(write=False)
    return across


@lru_cache(maxsize=64)
def _ball(rows: int, columns: int) -> Float64[ndarray, "r c 3"]:
    slope = np.linspace(0, np.pi, rows)[:, None]
    angle = np.linspace(0, 2 * np.pi, columns + 1)[None]
    around = np.stack(
        np.broadcast_arrays(np.sin(slope) * np.sin(angle), np.cos(slope), np.sin(slope) * np.cos(angle)), -1
    )
    around.setflags(write=False)
    return around


def grid_normals(points: Float[ndarray, "r c 3"], *, is_closed: bool = False) -> Float32[ndarray, "r c 3"]:
    """Returns unit normals of a grid by central differences. In a closed grid, the last column equals the first."""
    down = np.empty(points.shape, dtype=np.float32)
    down[1:-1], down[0], down[-1] = points[2:] - points[:-2], points[1] - points[0], points[-1] - points[-2]
    along = np.empty_like(down)
    along[:, 1:-1] = points[:, 2:] - points[:, :-2]
    along[:, 0] = points[:, 1] - (points[:, -2] if is_closed else points[:, 0])
    along[:, -1] = (points[:, 1] if is_closed else points[:, -1]) - points[:, -2]
    return unit(cross(down, along))


def sheet(
    points: Float[ndarray, "r c 3"],
    repeats: tuple[float, float] = (1.0, 1.0),
    *,
    is_closed: bool = False,
    normals: Float[ndarray, "r c 3"] | None = None,
) -> Solid:
    """Makes a surface through a grid of points.

    Args:
        points: Rows and columns of points; row direction x column direction points outward.
        repeats: Repeats of the texture along columns (u) and rows (v).
        is_closed: Whether the last column equals the first, where the surface is then smooth.
        normals: Unit normals; None computes them from the grid.
    """
    rows, columns = points.shape[:2]
    found = grid_normals(points, is_closed=is_closed) if normals is None else normals
    uv = grid_uv(rows, columns) * np.asarray(repeats, dtype=np.float32)
    return solid(points.reshape(-1, 3), grid_triangles(rows, columns), uv, found.reshape(-1, 3))


def tube(
    path: Float[ndarray, "n 3"],
    radii: Float[ndarray, "n 2"] | tuple[float, float] | float,
    upward: Float[ndarray, "3"] | Triple = (0.0, 1.0, 0.0),
    sides: int = 6,
    *,
    squareness: float = 0.0,
) -> Solid:
    """Makes a tube along a path, pointed at both ends.

    Args:
        path: Points of the axis.
        radii: Radii (sideways, upward) at each point, or one pair for all, or one number for a round tube.
        upward: Direction of the second radius; must not be parallel to the path.
        sides: Number of corners of the cross section.
        squareness: 0 is an ellipse, 1 nearly a box.
    """
    size = np.broadcast_to(np.asarray(radii, dtype=np.float64), (len(path), 2))
    path = np.concatenate([path[:1], path, path[-1:]])
    size = np.concatenate([np.zeros((1, 2)), size, np.zeros((1, 2))])
    ahead = np.gradient(path, axis=0)
    ahead[0], ahead[-1] = ahead[1], ahead[-2]
    ahead = unit(ahead)
    side = unit(cross(ahead, np.asarray(upward, dtype=np.float32)))
    up = cross(side, ahead)
    across = _section(sides, squareness)
    points = (
        path[:, None]
        + (size[:, :1] * across[:, 0])[..., None] * side[:, None]
        + (size[:, 1:] * across[:, 1])[..., None] * up[:, None]
    )
    normals = across[:, 0, None] * side[:, None] + across[:, 1, None] * up[:, None]
    normals[0] -= 4 * ahead[0]
    normals[-1] += 4 * ahead[-1]
    length = float(np.sqrt(np.square(np.diff(path, axis=0)).sum(axis=1)).sum())
    around = float(2 * np.pi * size.mean())
    return sheet(points, (max(around, 1) / 20, length / 20), is_closed=True, normals=unit(normals))


def lathe(profile: Float[ndarray, "n 2"], sides: int = 16) -> Solid:
    """Makes a solid of revolution about the y axis, with the profile (radius, y) from top to bottom."""
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    around = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=1)
    points = profile[:, 0, None, None] * around + profile[:, 1, None, None] * np.array([0.0, 1.0, 0.0])
    size = float(2 * np.pi * profile[:, 0].max()), float(np.abs(np.diff(profile, axis=0)).sum())
    return sheet(points, (size[0] / 20, size[1] / 20), is_closed=True)


def ellipsoid(radii: tuple[float, float, float], rows: int = 7, columns: int = 12) -> Solid:
    """Makes an ellipsoid around the origin with its poles on the y axis; radii in mm."""
    around = _ball(rows, columns)
    size = np.asarray(radii, dtype=np.float64)
    return sheet(around * size, (size[0] / 5, size[1] / 10), is_closed=True, normals=unit(around / size))


def box(size: tuple[float, float, float], repeats: float = 1.0) -> Solid:
    """Makes a box around the origin, with edge lengths in mm, and repeats of the texture on each side."""
    sides = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            corners = np.zeros((2, 2, 3))
            corners[..., axis] = sign
            corners[..., (axis + 1) % 3] = np.array([[-1.0, -1], [1, 1]]) * sign
            corners[..., (axis + 2) % 3] = np.array([[-1.0, 1], [-1, 1]])
            normals = np.zeros((2, 2, 3))
            normals[..., axis] = sign
            sides.append(sheet(corners * np.asarray(size) / 2, (repeats, repeats), normals=normals))
    return joined(sides)


def joined(solids: Sequence[Solid]) -> Solid:
    """Joins several solids into one."""
    starts = np.cumsum([0] + [len(one.vertices) for one in solids[:-1]])
    return Solid(
        np.concatenate([one.vertices for one in solids]),
        np.concatenate([one.triangles + np.int32(start) for one, start in zip(solids, starts, strict=True)]),
        np.concatenate([one.uv for one in solids]),
        np.concatenate([one.normals for one in solids]),
    )


def scene_mesh(name: str, label: str, made: Solid, material: Material, *, casts_shadow: bool = True) -> SceneMesh:
    """Makes the mesh of a solid with a material."""
    return SceneMesh(name=name, label=label, material=material, casts_shadow=casts_shadow, **vars(made))
