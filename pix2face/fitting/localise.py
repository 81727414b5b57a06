"""Where the vertices of the mean face are in the picture: the nearest PNCC pixel, refined to a fraction of a pixel."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from numpy import ndarray
from scipy.spatial import cKDTree

from pix2face.errors import DegenerateGeometryError
from pix2face.face_maps import FaceMaps

# A vertex is taken as seen where, after refinement, the PNCC is within this multiple of the distance that the nearest
# quarter of the vertices keeps (those are surely seen). Exact maps reach 0.01 mm there, and hidden vertices stand out
# from 0.25 mm on; predicted maps reach 1 to 2 mm, and their errors perpendicular to the surface need room. Some
# millimetres aside, the offset is nearly the same.
VISIBLE_MULTIPLE = 4.0
VISIBLE_LEAST_MM = 0.25
VISIBLE_MOST_MM = 5.0

# Differences to two opposite neighbours that are this unlike lie on both sides of a fold: the shorter one counts.
FOLD_RATIO = 3.0
# A difference to a lone neighbour counts up to this multiple of the median difference of the picture.
LONE_NEIGHBOUR_RATIO = 8.0


@final
@dataclass(frozen=True, eq=False)
class VertexPixels:
    """The vertices that were found in a picture.

    Attributes:
        vertex_indices: Which vertices, in the order of the query.
        points2d: Where, in pixels (x, y), centres at +0.5.
        offsets: The offset map there, mm.
        distance_mm: From the PNCC there to the vertex of the mean face.
    """

    vertex_indices: Int[ndarray, " n"]
    points2d: Float64[ndarray, "n 2"]
    offsets: Float64[ndarray, "n 3"]
    distance_mm: Float64[ndarray, " n"]


def localise_vertices(
    maps: FaceMaps,
    mean: Float[ndarray, "v 3"],
    vertex_indices: Int[ndarray, " m"],
    *,
    visible_within_mm: float | None = None,
) -> VertexPixels:
    """Finds vertices of the mean face by the nearest PNCC pixel, then to a fraction of a pixel.

    The refinement takes the PNCC as linear around the pixel and moves by the least-squares step, by at most one pixel
    in x and in y; the offset follows the same linear model.

    Args:
        maps: The maps of one picture.
        mean: The mean face, mm, model frame.
        vertex_indices: The vertices to look for.
        visible_within_mm: Vertices with a larger distance after refinement are taken as hidden and left out; None sets
            it by the quarter of the vertices that is nearest, see the constants above.

    Raises:
        DegenerateGeometryError: The maps are all background, or not finite inside the mask.

    Source: Crispell and Bazik 2017, Eq. 2.

    Deviation from the paper: which stops at the pixel. Half a pixel is up to 1 mm of the face in a 128 pixel crop.
    """
    rows, columns = np.nonzero(maps.mask)
    values = np.concatenate([maps.pncc[maps.mask], maps.offset[maps.mask]], axis=1).astype(np.float64)
    check_finite_pixels(values)
    targets = mean[vertex_indices].astype(np.float64)
    # Neighbouring pixels are neighbours in space, so a tree that is built in a hurry is as good as a balanced one.
    tree = cKDTree(values[:, :3], balanced_tree=False, compact_nodes=False)
    _, nearest = tree.query(targets)  # Eq. (2)
    rows, columns = rows[nearest], columns[nearest]
    centre = values[nearest]
    difference = targets - centre[:, :3]
    gradients = _gradients(maps, rows, columns)
    step = _least_squares_step(gradients[:, :, :3], difference)
    refined = centre + np.einsum("na,nac->nc", step, gradients)
    distance = np.linalg.norm(targets - refined[:, :3], axis=1)
    seen = distance <= (_visible_limit(distance) if visible_within_mm is None else visible_within_mm)
    points2d = np.column_stack([columns, rows]) + 0.5 + step
    return VertexPixels(vertex_indices[seen], points2d[seen], refined[seen, 3:], distance[seen])


def check_finite_pixels(values: Float[ndarray, "n c"]) -> None:
    """Refuses maps without any valid pixel or with values that are not finite.

    Raises:
        DegenerateGeometryError: See above.
    """
    if len(values) == 0:
        raise DegenerateGeometryError("expected maps with a face, found only background: no pixel is in the mask")
    if not np.isfinite(values).all():
        bad = int((~np.isfinite(values)).any(axis=1).sum())
        raise DegenerateGeometryError(f"expected finite maps, found {bad} of {len(values)} valid pixels not finite")


def _visible_limit(distances_mm: Float64[ndarray, " n"]) -> float:
    if len(distances_mm) == 0:
        return VISIBLE_MOST_MM
    quarter = float(np.percentile(distances_mm, 25))
    return float(np.clip(VISIBLE_MULTIPLE * quarter, VISIBLE_LEAST_MM, VISIBLE_MOST_MM))


def _gradients(maps: FaceMaps, rows: Int[ndarray, " n"], columns: Int[ndarray, " n"]) -> Float64[ndarray, "n 2 6"]:
    """Derivatives of PNCC and offset (mm per pixel) towards x and y; 0 where no neighbour tells."""
    values = np.pad(np.concatenate([maps.pncc, maps.offset], axis=2), ((1, 1), (1, 1), (0, 0)))
    mask = np.pad(maps.mask, 1)
    centre = values[rows + 1, columns + 1].astype(np.float64)
    per_axis = []
    for down, right in ((0, 1), (1, 0)):
        after = (rows + 1 + down, columns + 1 + right)
        before = (rows + 1 - down, columns + 1 - right)
        per_axis.append((values[after] - centre, mask[after], centre - values[before], mask[before]))
    lengths = [np.linalg.norm(forward[has, :3], axis=1) for forward, has, _, _ in per_axis]
    longest = LONE_NEIGHBOUR_RATIO * float(np.median(np.concatenate([*lengths, np.zeros(1)])))
    return np.stack([_one_derivative(*differences, longest) for differences in per_axis], axis=1)


def _one_derivative(
    forward: Float64[ndarray, "n 6"],
    has_forward: Bool[ndarray, " n"],
    backward: Float64[ndarray, "n 6"],
    has_backward: Bool[ndarray, " n"],
    longest_mm: float,
) -> Float64[ndarray, "n 6"]:
    """The central difference; one-sided beside background and folds."""
    a = np.where(has_forward, np.linalg.norm(forward[:, :3], axis=1), np.inf)
    b = np.where(has_backward, np.linalg.norm(backward[:, :3], axis=1), np.inf)
    shorter, is_smooth = np.minimum(a, b), np.maximum(a, b) <= FOLD_RATIO * np.minimum(a, b)
    one_sided = np.where((a <= b)[:, None], forward, backward)
    derivative = np.where((is_smooth & np.isfinite(shorter))[:, None], (forward + backward) / 2, one_sided)
    return np.where((shorter <= longest_mm)[:, None], derivative, 0.0)


def _least_squares_step(
    gradient: Float64[ndarray, "n 2 3"], difference: Float64[ndarray, "n 3"]
) -> Float64[ndarray, "n 2"]:
    """The step in pixels that brings the linear model nearest to the target, at most one pixel along each axis."""
    normal = np.einsum("nac,nbc->nab", gradient, gradient)
    normal += np.eye(2) * (1e-9 + 1e-6 * np.trace(normal, axis1=1, axis2=2)[:, None, None])
    right = np.einsum("nac,nc->na", gradient, difference)
    return np.clip(np.linalg.solve(normal, right[:, :, None])[:, :, 0], -1, 1)
