"""Where the vertices of the mean face are in the picture: the nearest PNCC pixel, refined to a fraction of a pixel."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.least_squares.robust import lengths
from pix2face.fitting.prepared_model import PreparedModel
from pix2face.geometry.maps import FaceMaps

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

# A pixel looks its vertex up in a grid only where a vertex has this many pixels; with fewer, some would go without.
LEAST_PIXELS_A_VERTEX = 4


@final
@dataclass(frozen=True, eq=False)
class VertexPixels:
    """The vertices that were found in a picture, in the order of the query."""

    places: Int[ndarray, " n"]  # the place of each vertex in the query
    points2d: Float64[ndarray, "n 2"]  # pixels (x, y), centres at +0.5
    offsets: Float64[ndarray, "n 3"]  # values of the offset map there, mm


def localise_prepared(maps: FaceMaps, pixels: "ValidPixels", prepared: PreparedModel) -> VertexPixels:
    """Finds vertices of the mean face by the nearest PNCC pixel, then to a fraction of a pixel.

    Each pixel looks up the vertex that its PNCC is near to, and each vertex keeps the nearest of its pixels. Where
    pixels are few, a tree answers instead. The refinement takes the PNCC as linear around the pixel and moves by the
    least-squares step, by at most one pixel in x and in y; the offset follows the same linear model.

    Source: Crispell and Bazik 2017, Eq. 2.

    Deviation from the paper: which stops at the pixel. Half a pixel is up to 1 mm of the face in a 128 pixel crop.
    """
    if len(pixels.places) < LEAST_PIXELS_A_VERTEX * len(prepared.mean):
        nearest = _nearest_by_tree(pixels.pncc, prepared.mean.astype(np.float64))
    else:
        nearest = _nearest_by_grid(pixels.pncc, prepared)
    places = np.flatnonzero(nearest >= 0)
    return _refined(maps, prepared, places, pixels.places[nearest[places]])


@final
@dataclass(frozen=True, eq=False)
class ValidPixels:
    """The pixels inside the mask."""

    places: Int[ndarray, " n"]  # row times width plus column
    pncc: Float32[ndarray, "n 3"]  # mm
    offset: Float32[ndarray, "n 3"]  # mm


def valid_pixel_values(maps: FaceMaps) -> ValidPixels:
    """Takes the pixels inside the mask.

    Raises:
        DegenerateGeometryError: There are none, or they are not finite.
    """
    places = np.flatnonzero(maps.mask)
    pixels = ValidPixels(
        places, *(np.take(values.reshape(-1, 3), places, axis=0) for values in (maps.pncc, maps.offset))
    )
    check_finite_pixels(pixels.pncc)
    check_finite_pixels(pixels.offset)
    return pixels


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


def _nearest_by_tree(pncc: Float32[ndarray, "n 3"], targets: Float64[ndarray, "m 3"]) -> Int[ndarray, " m"]:
    from scipy.spatial import cKDTree  # a sixth of a second, which commands that fit nothing save

    # Neighbouring pixels are neighbours in space, so a tree that is built in a hurry is as good as a balanced one.
    tree = cKDTree(pncc, balanced_tree=False, compact_nodes=False)
    return np.asarray(tree.query(targets)[1])  # Eq. (2)


def _nearest_by_grid(pncc: Float32[ndarray, "n 3"], prepared: PreparedModel) -> Int[ndarray, " m"]:
    """For each prepared vertex the nearest of the pixels that looked it up; -1 where none did."""
    vertex = prepared.grid.look_up(pncc)
    squared = sum((own - mean.take(vertex)) ** 2 for own, mean in zip(pncc.T, prepared.mean.T, strict=True))
    squared[vertex < 0] = np.inf
    least = np.full(len(prepared.mean), np.inf, dtype=np.float32)
    np.minimum.at(least, vertex, squared)
    nearest = np.full(len(prepared.mean), -1, dtype=np.intp)
    is_nearest = np.flatnonzero((squared == least[vertex]) & np.isfinite(squared))
    nearest[vertex[is_nearest]] = is_nearest
    return nearest


def _refined(
    maps: FaceMaps, prepared: PreparedModel, places: Int[ndarray, " n"], pixels: Int[ndarray, " n"]
) -> VertexPixels:
    """Moves from the centres of pixels to where the PNCC is nearest to the vertices, and leaves the hidden ones out."""
    targets = prepared.mean[places].astype(np.float64)
    rows, columns = np.divmod(pixels, maps.mask.shape[1])
    centre = _values_at(maps, pixels)
    gradients = _gradients(maps, rows, columns, centre)
    step = _least_squares_step(gradients[:, :, :3], targets - centre[:, :3])
    refined = centre + step[:, :1] * gradients[:, 0] + step[:, 1:] * gradients[:, 1]
    distance = lengths(targets - refined[:, :3])
    seen = np.flatnonzero(distance <= _visible_limit(distance))
    points2d = np.column_stack([columns, rows])[seen] + 0.5 + step[seen]
    return VertexPixels(places[seen], points2d, refined[seen, 3:])


def _values_at(maps: FaceMaps, pixels: Int[ndarray, " n"]) -> Float64[ndarray, "n 6"]:
    """PNCC and offset of pixels."""
    out = np.empty((len(pixels), 6))
    out[:, :3] = np.take(maps.pncc.reshape(-1, 3), pixels, axis=0)
    out[:, 3:] = np.take(maps.offset.reshape(-1, 3), pixels, axis=0)
    return out


def _visible_limit(distances_mm: Float64[ndarray, " n"]) -> float:
    if len(distances_mm) == 0:
        return VISIBLE_MOST_MM
    rank = len(distances_mm) // 4
    quarter = float(np.partition(distances_mm, rank)[rank])
    return float(np.clip(VISIBLE_MULTIPLE * quarter, VISIBLE_LEAST_MM, VISIBLE_MOST_MM))


def _gradients(
    maps: FaceMaps, rows: Int[ndarray, " n"], columns: Int[ndarray, " n"], centre: Float64[ndarray, "n 6"]
) -> Float64[ndarray, "n 2 6"]:
    """Derivatives of PNCC and offset (mm per pixel) towards x and y; 0 where no neighbour tells."""
    height, width = maps.mask.shape
    mask = maps.mask.reshape(-1)
    per_axis = []
    for position, size, stride in ((columns, width, 1), (rows, height, width)):
        pixel = rows * width + columns
        differences, has = [], []
        for sign in (1, -1):
            inside = (position < size - 1) if sign > 0 else (position > 0)
            neighbour = np.where(inside, pixel + sign * stride, pixel)
            valid = inside & mask[neighbour]
            difference = sign * (_values_at(maps, neighbour) - centre)
            difference[~valid] = 0  # whatever stands outside the mask
            differences.append(difference)
            has.append(valid)
        per_axis.append((differences[0], has[0], differences[1], has[1]))
    steps = [lengths(forward[valid, :3]) for forward, valid, _, _ in per_axis]
    longest = LONE_NEIGHBOUR_RATIO * float(np.median(np.concatenate([*steps, np.zeros(1)])))
    return np.stack([_one_derivative(*both_sides, longest) for both_sides in per_axis], axis=1)


def _one_derivative(
    forward: Float64[ndarray, "n 6"],
    has_forward: Bool[ndarray, " n"],
    backward: Float64[ndarray, "n 6"],
    has_backward: Bool[ndarray, " n"],
    longest_mm: float,
) -> Float64[ndarray, "n 6"]:
    """The central difference; one-sided beside background and folds."""
    a = np.where(has_forward, lengths(forward[:, :3]), np.inf)
    b = np.where(has_backward, lengths(backward[:, :3]), np.inf)
    shorter, is_smooth = np.minimum(a, b), np.maximum(a, b) <= FOLD_RATIO * np.minimum(a, b)
    usable = shorter <= longest_mm
    is_central = is_smooth & np.isfinite(shorter)
    # Shares of the two differences in the derivative.
    ahead = np.where(is_central, 0.5, a <= b) * usable
    behind = np.where(is_central, 0.5, a > b) * usable
    return ahead[:, None] * forward + behind[:, None] * backward


def _least_squares_step(
    gradient: Float64[ndarray, "n 2 3"], difference: Float64[ndarray, "n 3"]
) -> Float64[ndarray, "n 2"]:
    """The step in pixels that brings the linear model nearest to the target, at most one pixel along each axis."""
    x, y = gradient[:, 0], gradient[:, 1]
    xx, xy, yy, right_x, right_y = (
        np.einsum("nd,nd->n", a, b) for a, b in ((x, x), (x, y), (y, y), (x, difference), (y, difference))
    )
    ridge = 1e-9 + 1e-6 * (xx + yy)
    xx, yy = xx + ridge, yy + ridge
    inverse = 1 / (xx * yy - xy * xy)
    step = np.column_stack([(yy * right_x - xy * right_y) * inverse, (xx * right_y - xy * right_x) * inverse])
    return np.clip(step, -1, 1)
