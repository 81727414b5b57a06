"""Camera and mesh held to the silhouette: whatever the face is, it projects into its mask.

From predicted PNCC alone the turn of a head is known badly. The visible side of a turned head is nearly flat, so what
tells its turn are small differences across it, and a network's errors there are alike over patches: in photographs
heads came out turned 10 to 20 degrees too little, with a far cheek that lay beside the head. The predicted mask ends
where the head does. Only one direction counts, that nothing of the face lies outside: pulling the mesh out to the
mask's border as well did harm (docs/explanation/fitting.md), perhaps since it is a guess where hair and hands hide it.

Deviation from the paper: whose camera goes by PNCC alone (Eq. 1).
"""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64
from numpy import ndarray

from pix2face.fitting.least_squares.levenberg_marquardt import LocalQuadratic, minimise
from pix2face.fitting.least_squares.linear_system import ImageSystem
from pix2face.fitting.least_squares.moments import Moments, stacked
from pix2face.fitting.least_squares.similarity import Similarity
from pix2face.geometry.camera import Camera, nearest_weak_perspective
from pix2face.geometry.maps import FaceMaps, face_box, without_holes

# A vertex on the silhouette lies up to a pixel beyond the centre of the last pixel that shows the face. Predicted masks
# lack one pixel more; to allow for that as well made photographs slightly worse.
SLACK_PX = 1.0
# So many pixels before the photograph ends its mask is taken to go on: it lacks its outermost pixels there as well.
END_PX = 2
# The field reaches so far around the maps, as a share of their side; beyond, its border's value holds.
REACH_SHARE = 0.25
# So much farther than the model's origin, which is inside the head, a vertex is on its far side. Some room is left for
# faces whose turn is underestimated.
FAR_SIDE_MM = 20.0
# A vertex farther beyond the mask than this share of the maps' side pulls as one there: the mask may be wrong.
FARTHEST_SHARE = 1 / 16
# Both terms of the camera's cost are mean distances, rounded off below this share of the maps' side (half a pixel of
# 128): of pixels from where their points project to, and of vertices beyond the mask. They weigh alike.
ROUNDED_SHARE = 1 / 256
RELATIVE_DECREASE = 3e-3
MAX_ITERATIONS = 15


@final
@dataclass(frozen=True, eq=False)
class FaceSurface:
    """Vertices of the whole face, seen or not."""

    vertices: Float[ndarray, "n 3"]  # mm, model frame
    mean: Float32[ndarray, "n 3"]  # the same in the mean face

    def on_near_side(self, rotation: Float[ndarray, "3 3"]) -> Bool[ndarray, " n"]:
        """Which are not on the far side for a camera of this rotation (camera_from_model).

        Neck and scalp may hide those that are: the far ear of a profile lies beyond the mask, and rightly.
        """
        return np.asarray(self.mean @ rotation[2] < FAR_SIDE_MM)


@final
@dataclass(frozen=True, eq=False)
class OutsideDistance:
    """How far beyond the mask a place in the picture is."""

    # 0 inside, and within ``SLACK_PX``; at the centres of the enlarged picture's pixels.
    distance_px: Float32[ndarray, "y x"]
    reach_px: int  # by how much it is enlarged on each side
    side_px: int  # the longer side of the mask

    @classmethod
    def of(cls, maps: FaceMaps) -> "OutsideDistance":
        """Of maps whose mask has at least one pixel.

        Holes, such as an open mouth, belong to it. What the end of the photograph or of the crop cuts off goes on.
        """
        whole = without_holes(maps.mask)
        height, width = maps.mask.shape
        side_px = max(height, width)
        reach_px = max(1, round(REACH_SHARE * side_px))
        rows, columns = _in_photograph(maps)
        beyond = (
            (reach_px + rows.start, reach_px + height - rows.stop),
            (reach_px + columns.start, reach_px + width - columns.stop),
        )
        distance = cv2.distanceTransform(1 - np.pad(whole[rows, columns], beyond, mode="edge"), cv2.DIST_L2, 5)
        return cls(np.maximum(distance - np.float32(SLACK_PX), 0, dtype=np.float32), reach_px, side_px)

    def at(self, points2d: Float64[ndarray, "n 2"]) -> tuple[Float64[ndarray, " n"], Float64[ndarray, "n 2"]]:
        """Distance and its slope at places (pixels, centres at +0.5), linear between the centres of four pixels."""
        height, width = self.distance_px.shape
        # Unlike `clip`, `fmax` replaces NaN by the limit.
        place = np.fmin(np.fmax(points2d + (self.reach_px - 0.5), 0.0), np.array([width, height]) - 1.001)
        corner = place.astype(np.intp)
        right, down = (place - corner).T
        flat = corner[:, 1] * width + corner[:, 0]
        field = self.distance_px.reshape(-1)
        a, b, c, d = field[flat + np.array([0, 1, width, width + 1])[:, None]].astype(np.float64)
        across_above, across_below = b - a, d - c
        above, below = a + across_above * right, c + across_below * right
        slope = np.array([across_above + (across_below - across_above) * down, below - above])
        return above + (below - above) * down, slope.T


def fit_camera_to_silhouette(
    start: Camera,
    points3d: Float[ndarray, "n 3"],
    points2d: Float[ndarray, "n 2"],
    face: FaceSurface,
    outside: OutsideDistance,
) -> Camera:
    """The weak-perspective camera with the least mean distance of correspondences and of vertices beyond the mask.

    The correspondences are points of the face (mm, model frame) and the pixels that show them (centres at +0.5).
    """
    origin, centre2d = points3d.mean(axis=0), points2d.mean(axis=0)
    pixels = stacked(points3d - origin, points2d - centre2d)
    vertices = np.column_stack([face.vertices - origin, np.ones(len(face.vertices))])
    rounding = ROUNDED_SHARE * outside.side_px

    def local_quadratic(state: Similarity) -> LocalQuadratic:
        residuals = pixels[:, :4] @ state.matrix.T - pixels[:, 4:]
        to_pixels = _rounded(np.einsum("nd,nd->n", residuals, residuals), rounding)
        of_pixels = Moments.of(pixels, 1 / (len(pixels) * to_pixels)).quadratic(state)
        distance, slope = outside.at(vertices @ state.matrix.T + centre2d)
        beyond = np.flatnonzero((distance > 0) & face.on_near_side(state.rotation))
        to_border = _rounded(distance[beyond] ** 2, rounding)
        # The derivative of slope . (M y) is <slope y^T, dM>.
        products = (slope[beyond][:, :, None] * vertices[beyond][:, None]).reshape(-1, 8)
        jacobian = products @ state.derivative.reshape(6, 8).T
        weighted = jacobian / (len(vertices) * to_border)[:, None]
        cost = to_pixels.mean() - rounding + (to_border - rounding).sum() / len(vertices)
        return LocalQuadratic(
            float(cost), of_pixels.gradient + distance[beyond] @ weighted, of_pixels.hessian + jacobian.T @ weighted
        )

    nearest = nearest_weak_perspective(start)
    shift = start.project(origin[None])[0] - centre2d
    found, _ = minimise(
        Similarity(float(np.log(nearest.scale)), nearest.rotation, shift),
        local_quadratic,
        Similarity.moved,
        relative_decrease=RELATIVE_DECREASE,
        max_iterations=MAX_ITERATIONS,
    )
    return found.shifted(centre2d).camera(origin)


def _in_photograph(maps: FaceMaps) -> tuple[slice, slice]:
    """Rows and columns that show the photograph, without the last ones before it ends within the crop."""
    if maps.in_photograph is None or not maps.in_photograph.any():
        return slice(0, maps.mask.shape[0]), slice(0, maps.mask.shape[1])
    rows, columns = (
        slice(part.start + END_PX * (part.start > 0), part.stop - END_PX * (part.stop < side))
        for part, side in zip(face_box(maps.in_photograph), maps.mask.shape, strict=True)
    )
    return (rows, columns) if maps.mask[rows, columns].size else face_box(maps.in_photograph)


def _rounded(squared: Float64[ndarray, " n"], rounding: float) -> Float64[ndarray, " n"]:
    """Distances from their squares, rounded off near 0."""
    return np.asarray(np.sqrt(squared + rounding**2), dtype=np.float64)


def with_silhouette(
    camera: Camera,
    face: FaceSurface,
    basis: Float[ndarray, "n 3 c"],
    outside: OutsideDistance,
    system: ImageSystem,
) -> ImageSystem:
    """Adds a row for each vertex that lies beyond the mask: it should move to its border, along the shortest way.

    The camera is weak-perspective; the basis is that of the face's vertices, mm per standard deviation.
    """
    nearest = nearest_weak_perspective(camera)
    distance, slope = outside.at(camera.project(face.vertices.astype(np.float64)))
    beyond = np.flatnonzero((distance > 0) & face.on_near_side(nearest.rotation))
    if not len(beyond):
        return system
    scale = nearest.scale
    # Millimetres, as the other rows are, and as heavy.
    away = (slope[beyond] @ camera.matrix[:2, :3] / scale).astype(basis.dtype)
    rows = (away[:, None] @ basis[beyond])[:, 0]
    moved_so_far = (away * (face.vertices[beyond] - face.mean[beyond])).sum(axis=1)
    inwards = np.minimum(distance[beyond], FARTHEST_SHARE * outside.side_px) / scale
    targets = (moved_so_far - inwards).astype(basis.dtype)
    normal, right = system.normal + rows.T @ rows, system.right + targets @ rows
    return ImageSystem(normal, right, system.weights, offsets_only=system.offsets_only or system)
