"""A slow, obvious, exact rasteriser in float64: the oracle of the OpenGL renderer, and good enough for overlays.

Every triangle is tested against every pixel centre in its bounding box; the nearest one wins. Conventions that the
renderer shares:

- A pixel belongs to a triangle when its centre (column + 0.5, row + 0.5) is inside, edges decided by the top-left rule.
- Nothing is culled. A triangle that shows its back (the inside of the skull, seen through the open neck) hides what is
  behind it, but it is never face. Which side is which follows from the winding in the image and from the handedness
  of the camera, so that mirrored crops work.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32, Int64
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError
from pix2face.geometry.camera import Camera
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.surface_attributes import ATTRIBUTES, REGIONS

# The depth of whatever is nearest, face or not, in mm; inf outside the head. Renderers give it beside the layers.
SURFACE_DEPTH = "surface_depth"
# How many (triangle, pixel) candidates are tested at a time: bounds the memory to some 100 MB.
CANDIDATES_AT_A_TIME = 500_000


@final
@dataclass(frozen=True, eq=False)
class Fragments:
    """What each pixel sees."""

    triangle: Int32[ndarray, "h w"]  # the nearest one; -1 where there is none
    # Weights of its three vertices at the pixel centre on the surface (perspective-correct); 0 outside.
    barycentric: Float64[ndarray, "h w 3"]
    depth: Float64[ndarray, "h w"]  # of the surface, in mm, as ``Camera.depth`` has it; inf outside


def rasterise(
    camera_matrix: Float64[ndarray, "4 4"],
    vertices: Float[ndarray, "v 3"],
    triangles: Int[ndarray, "t 3"],
    height: int,
    width: int,
) -> Fragments:
    """Finds the nearest triangle of each pixel. Vertices are in mm, in the model frame.

    Raises:
        DegenerateGeometryError: A vertex lies in or behind the plane of a pinhole, or is not finite.
    """
    homogeneous = project_homogeneous(camera_matrix, vertices)
    # A row for each corner, since NumPy gathers and adds long rows fastest.
    depths, w = (homogeneous[:, k][triangles.T] for k in (2, 3))
    screen = (homogeneous[:, :2] / homogeneous[:, 3:])[triangles]
    nearest = np.full(height * width, np.inf)
    triangle = np.full(height * width, -1, dtype=np.int32)
    weights = np.zeros((height * width, 3))
    for index, row, column in _candidates(screen, height, width):
        inside, true_weights = _cover(screen, index, row, column)
        covering, pixel = index.take(inside), (row * width + column).take(inside)
        true_weights /= w.take(covering, axis=1)
        true_weights /= true_weights.sum(axis=0)
        depth = (true_weights * depths.take(covering, axis=1)).sum(axis=0)
        near = np.flatnonzero(depth < nearest.take(pixel))
        np.minimum.at(nearest, pixel.take(near), depth.take(near))
        seen = near[depth.take(near) == nearest.take(pixel.take(near))]
        seen = seen[::-1]  # the last that is written stays: of equally near triangles, the first
        triangle[pixel[seen]], weights[pixel[seen]] = covering[seen], true_weights[:, seen].T
    shape = (height, width)
    return Fragments(triangle.reshape(shape), weights.reshape(*shape, 3), nearest.reshape(shape))


def interpolate(
    fragments: Fragments, attribute: Float[ndarray, "v c"], triangles: Int[ndarray, "t 3"]
) -> Float64[ndarray, "h w c"]:
    """Interpolates a quantity given per vertex over the surface that each pixel sees; 0 where there is none."""
    corners = attribute[triangles[fragments.triangle]].astype(np.float64)  # -1 picks some triangle, with weights 0
    return np.asarray(np.einsum("hwkc,hwk->hwc", corners, fragments.barycentric))


def render_maps(
    model: MorphableModel,
    vertices: Float[ndarray, "v 3"],
    camera: Camera,
    height: int,
    width: int,
    layers: Sequence[str] = (),
) -> dict[str, ndarray]:
    """Renders PNCC, offset, mask, depth and what is asked for of one face: what the OpenGL renderer must reproduce.

    The vertices are those of this face (mm, model frame, not posed). Further layers are those of
    ``surface_attributes.EXTRA_LAYERS``; other names are passed over.

    Returns:
        ``pncc``, ``offset``, ``mask``, ``depth`` and the further layers, as ``pix2face.shards.layers`` describes them,
        and ``SURFACE_DEPTH``, (h, w) float32.

    Raises:
        DegenerateGeometryError: The camera flattens space, or part of the face is behind a pinhole.
        UsageError: The model has not what a layer needs.

    Source: Crispell and Bazik 2017, Sec. 3 (PNCC and offset images).
    """
    fragments = rasterise(camera.matrix, vertices, model.triangles, height, width)
    is_face = model.is_face_triangle & shows_outside(camera, vertices, model.triangles)
    mask = (fragments.triangle >= 0) & is_face[fragments.triangle]
    mean = model.mean.astype(np.float64)
    pncc = interpolate(fragments, mean, model.triangles) * mask[..., None]
    offset = interpolate(fragments, vertices - mean, model.triangles) * mask[..., None]
    extra = {
        name: _attribute(name, model, vertices.astype(np.float32), camera, fragments) * mask[..., None]
        for name in layers
        if name in ATTRIBUTES
    }
    if REGIONS in layers:
        region = model.triangle_regions[fragments.triangle] + np.uint8(1)
        extra[REGIONS] = np.where(fragments.triangle >= 0, region, 0).astype(np.uint8)
    return {
        "pncc": pncc.astype(np.float32),
        "offset": offset.astype(np.float32),
        "mask": mask,
        "depth": np.where(mask, fragments.depth, 0).astype(np.float32),
        SURFACE_DEPTH: fragments.depth.astype(np.float32),
        **extra,
    }


def _attribute(
    name: str, model: MorphableModel, vertices: Float32[ndarray, "v 3"], camera: Camera, fragments: Fragments
) -> Float32[ndarray, "h w c"]:
    attribute = ATTRIBUTES[name]
    values = interpolate(fragments, attribute.values(model, vertices, camera), attribute.corners(model))
    if attribute.is_direction:
        length = np.linalg.norm(values, axis=-1, keepdims=True)
        values /= np.where(length > 0, length, 1)
    return values.astype(np.float32)


def project_homogeneous(
    camera_matrix: Float64[ndarray, "4 4"], vertices: Float[ndarray, "v 3"]
) -> Float64[ndarray, "v 4"]:
    """Vertices as (u w, v w, depth, w).

    Raises:
        DegenerateGeometryError: A vertex lies in or behind the plane of a pinhole, or is not finite.
    """
    homogeneous = vertices.astype(np.float64) @ camera_matrix[:, :3].T + camera_matrix[:, 3]
    if not np.isfinite(homogeneous).all():
        raise DegenerateGeometryError("expected finite vertices and camera, found infinite or undefined projections")
    if homogeneous[:, 3].min(initial=1) <= 0:
        raise DegenerateGeometryError(
            f"expected the whole face in front of the camera, found vertices down to {homogeneous[:, 3].min():.1f} mm"
        )
    return np.asarray(homogeneous)


def handedness(camera: Camera) -> int:
    """1 for a camera as it comes, -1 for one that mirrors.

    Raises:
        DegenerateGeometryError: The camera flattens space: its pixels do not tell the depth of points apart.
    """
    determinant = float(np.linalg.det(camera.matrix[:3, :3]))
    if not abs(determinant) > 0:
        raise DegenerateGeometryError(
            "expected a camera with independent rows for u, v and depth, found dependent ones"
        )
    return 1 if determinant > 0 else -1


def shows_outside(
    camera: Camera, vertices: Float[ndarray, "v 3"], triangles: Int[ndarray, "t 3"]
) -> Bool[ndarray, " t"]:
    """Which triangles turn their outside to the camera.

    Triangles wind counter-clockwise seen from outside: with v downward the signed area in the image is negative.
    """
    screen = camera.project(vertices)[triangles]
    return np.asarray(_doubled_area(screen) * handedness(camera) < 0)


def _doubled_area(screen: Float64[ndarray, "t 3 2"]) -> Float64[ndarray, " t"]:
    ab, ac = screen[:, 1] - screen[:, 0], screen[:, 2] - screen[:, 0]
    return np.asarray(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])


def _candidates(
    screen: Float64[ndarray, "t 3 2"], height: int, width: int
) -> Iterator[tuple[Int64[ndarray, " n"], Int64[ndarray, " n"], Int64[ndarray, " n"]]]:
    """Pairs of a triangle and a pixel (row, column) in its bounding box, in portions."""
    limit = np.array([width, height])
    first = np.clip(np.ceil(screen.min(axis=1) - 0.5), 0, limit).astype(np.int64)
    last = np.clip(np.floor(screen.max(axis=1) - 0.5) + 1, 0, limit).astype(np.int64)
    columns, rows = np.maximum(last - first, 0).T
    ends = np.cumsum(columns * rows)
    starts = np.searchsorted(ends, np.arange(0, ends.max(initial=1), CANDIDATES_AT_A_TIME))
    for start, stop in zip(starts, [*starts[1:], len(ends)], strict=True):
        counts = (columns * rows)[start:stop]
        index = np.repeat(np.arange(start, stop), counts)
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        down, right = np.divmod(within, columns[index])
        yield index, first[index, 1] + down, first[index, 0] + right


def _cover(
    screen: Float64[ndarray, "t 3 2"],
    index: Int64[ndarray, " n"],
    row: Int64[ndarray, " n"],
    column: Int64[ndarray, " n"],
) -> tuple[Int64[ndarray, " m"], Float64[ndarray, "3 m"]]:
    """Which of the pixel centres are in the triangles of these indices, and their weights in the image plane."""
    area = _doubled_area(screen)
    turn = np.where(area < 0, -1.0, 1.0)  # after it, inside is positive for every winding
    x, y = screen.transpose(2, 1, 0).copy()
    inside, sides = np.flatnonzero(area.take(index)), np.empty((0, len(index)))
    for k in range(3):
        start, end = (k + 1) % 3, (k + 2) % 3
        edge_x, edge_y = (x[end] - x[start]) * turn, (y[end] - y[start]) * turn
        # An edge that runs up is a left one, a level one to the right is a top one: they own the centres on them.
        owns = (edge_y < 0) | ((edge_y == 0) & (edge_x > 0))
        own = index.take(inside)
        to_x, to_y = column.take(inside) + 0.5 - x[start].take(own), row.take(inside) + 0.5 - y[start].take(own)
        side = edge_x.take(own) * to_y - edge_y.take(own) * to_x
        kept = np.flatnonzero((side > 0) | ((side == 0) & owns.take(own)))
        inside, sides = inside.take(kept), np.vstack([sides.take(kept, axis=1), side.take(kept)])
    return inside, sides / np.abs(area).take(index.take(inside))
