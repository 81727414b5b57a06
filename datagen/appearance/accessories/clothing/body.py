"""Neck and shoulders below a head: a surface from the rim of the model's neck down, which turns with the torso."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import final

import numpy as np
from jaxtyping import Float, Float32, Float64, Int32, Int64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from datagen.appearance.accessories.head_fit import neck_rim
from datagen.appearance.scene import PosedHead
from datagen.appearance.solids import Solid, grid_normals, grid_triangles, sheet, solid, unit

# Rings below the rim: place, half width, z of back and front, y of front, back and sides; mm. The place is -1 at the
# rim of the neck, 0 where it meets the shoulders, and 1 at the chest.
_RINGS = np.array(
    [
        [-0.60, 51, -71, 27, -127, -55, -97],
        [-0.25, 52, -84, 15, -149, -87, -120],
        [0.00, 58, -97, 8, -163, -112, -136],
        [0.15, 90, -112, 28, -178, -130, -150],
        [0.40, 150, -122, 52, -203, -160, -168],
        [0.60, 190, -126, 66, -232, -195, -190],
        [0.75, 210, -126, 74, -265, -235, -228],
        [1.00, 220, -122, 84, -420, -420, -420],
    ],
    dtype=np.float64,
)
_PLACES = np.concatenate([np.linspace(-1, 0, 9), [0.04, 0.09, 0.15, 0.22, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0]])
_PIVOT = np.array([0.0, -135.0, -45.0])
_FINE_ROWS = 3  # rows of the skin with all vertices: under the rim, at the rim, and the next one below
_LAP_MM = 0.7  # depth of the neck under the skin of the head, where they overlap


@final
@dataclass(frozen=True, eq=False)
class Body:
    """Neck and shoulders as a grid: rows from the rim down, columns from the back over the right side to the front."""

    points: Float32[ndarray, "r c 3"]  # mm, model frame
    normals: Float32[ndarray, "r c 3"]  # unit, outward
    lap: Float32[ndarray, "c 3"]  # row of points above the rim, slightly under the skin of the head
    head_from_torso: Float64[ndarray, "3 3"]  # rotation

    def at(
        self, place: Float[ndarray, "*#n"], turn: Float[ndarray, "*#n"], above_mm: Float[ndarray, "*#n"] | float
    ) -> Float32[ndarray, "*_ 3"]:
        """Returns points above the skin.

        Args:
            place: Place along the body, from -1 to 1.
            turn: Place around the body: 0 is the front, 0.25 the left side, 0.5 the back. Values are periodic.
            above_mm: Distance from the skin.
        """
        place, turn, above_mm = np.broadcast_arrays(place, turn, above_mm)
        rows = np.interp(place, _PLACES, np.arange(len(_PLACES)))
        around = self.points.shape[1] - 1
        columns = np.mod(np.asarray(turn) + 0.5, 1.0) * around
        row = np.minimum(rows.astype(np.intp), len(_PLACES) - 2)
        column = np.minimum(columns.astype(np.intp), around - 1)
        down, along = (rows - row).astype(np.float32), (columns - column).astype(np.float32)
        height = np.asarray(above_mm, dtype=np.float32)[..., None]
        first = row * (around + 1) + column
        found = np.zeros((*rows.shape, 6), dtype=np.float32)
        for step, share in (
            (0, (1 - down) * (1 - along)),
            (1, (1 - down) * along),
            (around + 1, down * (1 - along)),
            (around + 2, down * along),
        ):
            found += share[..., None] * self._grid.take(first + step, axis=0)
        return found[..., :3] + height * found[..., 3:]

    @cached_property
    def _grid(self) -> Float32[ndarray, "n 6"]:
        """Points and normals side by side."""
        return np.concatenate([self.points, self.normals], axis=-1).reshape(-1, 6)

    def skin(self, down_to: float) -> Solid:
        """Makes the bare skin from under the rim down to a place.

        Next to the rim, it has all vertices of the head. Below, it has only every second one, which is enough and saves
        time, since it is drawn five times, for shadows and for the picture.
        """
        rows = min(max(int(np.searchsorted(_PLACES, down_to)) + 2, _FINE_ROWS), len(_PLACES))
        points = np.concatenate([self.lap[None], self.points[:rows]])
        normals = np.concatenate([self.normals[:1], self.normals[:rows]])
        kept, triangles = _thinned_grid(len(points), points.shape[1])
        whole = sheet(points, (8.0, 8.0 * rows / len(_PLACES)), normals=normals)
        return solid(whole.vertices[kept], triangles, whole.uv[kept], whole.normals[kept])


def fit_body(head: PosedHead, head_from_torso: Float64[ndarray, "3 3"], breadth: float = 1.0) -> Body:
    """Makes the body of a head, from the rim of its neck down.

    Args:
        head: The head.
        head_from_torso: Rotation from a torso that is aligned with the head to the actual torso, model frame.
        breadth: Breadth of the shoulders; 1 is a man's.
    """
    rim, inside = (indices[::-1] for indices in neck_rim(head.model))
    edge, inner = head.vertices[rim].astype(np.float64), head.vertices[inside].astype(np.float64)
    mean = head.model.mean[rim]
    shift = edge[:-1].mean(axis=0) - mean[:-1].mean(axis=0)
    size = float(np.ptp(edge[:, 0]) / np.ptp(mean[:, 0]))
    rings = _rings(len(rim), size, breadth) + shift
    ahead = _smoothed_around(inner - edge)
    keys = np.concatenate([(edge + ahead)[None], edge[None], rings])
    points = (_spline_weights() @ keys.reshape(len(keys), -1)).reshape(-1, *keys.shape[1:])
    points = _turned(points, head_from_torso, _PIVOT + shift)
    points[0] = edge
    normals = grid_normals(points, is_closed=True)
    at_rim = head.normals[rim]
    normals[0] = at_rim
    normals[1] = unit(normals[1] + 0.5 * at_rim)
    lap = inner - _LAP_MM * head.normals[inside]
    return Body(points.astype(np.float32), normals, lap.astype(np.float32), head_from_torso)


def _rings(columns: int, size: float, breadth: float) -> Float64[ndarray, "k c 3"]:
    """Returns the rings below the rim, for the mean head."""
    place = _RINGS[:, :1]
    wide = np.where(place < 0.1, size, np.where(place < 0.3, 0.5 + 0.5 * size, breadth))
    rings = _mean_rings(columns).copy()
    rings[..., 0] *= wide
    return rings


@lru_cache(maxsize=4)
def _mean_rings(columns: int) -> Float64[ndarray, "k c 3"]:
    """Returns the rings without scaling of the width. They are cached: copy them before writing."""
    angle = np.linspace(0, 2 * np.pi, columns)
    sine, cosine = np.sin(angle), np.cos(angle)
    place, width, back, front, y_front, y_back, y_side = _RINGS.T[:, :, None]
    boxy = 1 - 0.3 * np.clip(place / 0.6, 0, 1)
    x = -width * np.sign(sine) * np.abs(sine) ** boxy
    z = 0.5 * (front + back) - 0.5 * (front - back) * np.sign(cosine) * np.abs(cosine) ** boxy
    ahead = 0.5 * (1 - cosine)
    y = y_front * ahead + y_back * (1 - ahead) + (y_side - 0.5 * (y_front + y_back)) * sine**2
    return np.stack([x, y, z], axis=-1)


@lru_cache(maxsize=64)
def _thinned_grid(rows: int, columns: int) -> tuple[Int64[ndarray, " n"], Int32[ndarray, "t 3"]]:
    """Returns the kept vertices and the triangles of a grid that has every second column below `_FINE_ROWS` rows."""
    assert columns % 2, "expected a rim with an even number of vertices, of which the first is repeated at the end"
    fine, thin = _FINE_ROWS * columns, np.arange(0, columns, 2)
    below = np.arange(_FINE_ROWS, rows)[:, None] * columns + thin
    kept = np.concatenate([np.arange(fine), below.reshape(-1)])
    left, right = np.arange(len(thin) - 1), np.arange(1, len(thin))
    seam = fine - columns + thin
    # A fan of three triangles joins two columns to one without gaps.
    a, b = seam[:-1], seam[1:]
    middle = a + 1
    fan = [(a, fine + left, middle), (middle, fine + left, fine + right), (middle, fine + right, b)]
    parts = [
        grid_triangles(_FINE_ROWS, columns),
        np.stack([np.stack(corners, axis=1) for corners in fan], axis=1).reshape(-1, 3),
        fine + grid_triangles(rows - _FINE_ROWS, len(thin)),
    ]
    triangles = np.concatenate(parts).astype(np.int32)
    for each in (kept, triangles):
        each.setflags(write=False)
    return kept, triangles


@lru_cache(maxsize=1)
def _spline_weights() -> Float64[ndarray, "r k"]:
    """Returns the matrix that interpolates the rings to rows of the grid by a spline along the body."""
    from scipy.interpolate import CubicSpline  # here, since it takes a third of a second to import

    keys = np.concatenate([[-1.07, -1.0], _RINGS[:, 0]])  # -1.07 is the place of the vertices next to the rim
    return np.asarray(CubicSpline(keys, np.eye(len(keys)), bc_type="natural")(_PLACES))


def _smoothed_around(vectors: Float64[ndarray, "c 3"]) -> Float64[ndarray, "c 3"]:
    """Returns the moving mean over the columns of a ring whose last column equals its first."""
    ring = vectors[:-1]
    wide = np.concatenate([ring[-5:], ring, ring[:4]])
    summed = np.cumsum(wide, axis=0)
    smooth = (summed[9:] - summed[:-9]) / 9
    return np.concatenate([smooth, smooth[:1]])


def _turned(
    points: Float64[ndarray, "r c 3"], head_from_torso: Float64[ndarray, "3 3"], pivot: Float64[ndarray, "3"]
) -> Float64[ndarray, "r c 3"]:
    """Rotates rows with the torso: not at all at the rim, and completely from the shoulders on."""
    share = np.clip(_PLACES + 1, 0, 1)
    share = share * share * (3 - 2 * share)
    turns = Rotation.from_rotvec(share[:, None] * Rotation.from_matrix(head_from_torso).as_rotvec()).as_matrix()
    return (points - pivot) @ turns.transpose(0, 2, 1) + pivot
