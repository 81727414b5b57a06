"""Projects a posed face for the rasterisers (float64 to float32 on the screen), and describes the way back."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from datagen.rendering.processor.projection import extremes, project_affine, project_pinhole, smallest_depth
from pix2face.errors import DegenerateGeometryError
from pix2face.geometry.camera import Camera
from pix2face.models.rasterise import handedness


@final
@dataclass(frozen=True, eq=False)
class ScreenProjection:
    """Where the vertices are in the image, and where a pixel at some depth is in the model frame.

    The order of a point is in mm, grows with distance and is linear in the image: for an affine camera its depth
    relative to ``reference_mm``, for a pinhole with r = ``reference_mm`` it is r - r² / depth. So
    ``depth = r + order / (1 - order * inverse_distance)`` for both, and a point of the model is ``middle_point`` +
    across + (depth - r) (along_depth + inverse_distance across), where across = (column - middle[0]) along_column +
    (row - middle[1]) along_row. All these numbers are of the size of the face, which float32 needs.
    """

    screen: Float32[ndarray, "v 4"]  # column, row (px) and order (mm) of each vertex; the fourth number has no meaning
    box_px: tuple[int, int, int, int]  # left, top, right, bottom of what the face may cover; the last two are excluded
    order_range_mm: tuple[float, float]  # smallest and largest order
    reference_mm: float  # depth of order 0
    inverse_distance: float  # 1 / `reference_mm` for a pinhole, 0 for an affine camera
    outside_sign: int  # sign of the area in the image of triangles that show their outside
    middle: Float64[ndarray, "2"]  # column and row (px) that the box has in its middle
    middle_point: Float64[ndarray, "3"]  # model point of the middle at order 0, mm
    along_column: Float64[ndarray, "3"]  # mm per pixel at order 0
    along_row: Float64[ndarray, "3"]  # mm per pixel at order 0
    along_depth: Float64[ndarray, "3"]  # mm per mm of depth


def project_to_screen(
    camera: Camera,
    vertices: Float32[ndarray, "v 3"],
    height: int,
    width: int,
    screen: Float32[ndarray, "v 4"] | None = None,
) -> ScreenProjection:
    """Projects a face, whose vertices are in mm in the model frame.

    ``screen`` is written to, if it is given: new memory costs as much as the projection.

    Raises:
        DegenerateGeometryError: A vertex lies in or behind the plane of a pinhole, or is not finite; the camera
            flattens space, or is a pinhole whose depth is not its w.
    """
    outside_sign = -handedness(camera)
    on_screen = np.empty((len(vertices), 4), dtype=np.float32) if screen is None else screen
    rows = camera.matrix.copy()
    if camera.is_affine:
        reference, rows[2, 3] = float(rows[2, 3]), 0.0
        project_affine(vertices, rows, on_screen)
    else:
        reference = _nearest_mm(camera, vertices)
        project_pinhole(vertices, rows, reference, on_screen)
    # Plain numbers: NumPy would take nearly as long for so few as it took to find them.
    low, high = extremes(on_screen.view(np.int32)).view(np.float32).tolist()
    if not all(map(math.isfinite, (*low, *high))):
        raise DegenerateGeometryError("expected finite vertices and camera, found infinite or undefined projections")
    left, top = (min(max(math.floor(place), 0), end) for place, end in zip(low, (width, height), strict=False))
    right, bottom = (min(max(math.ceil(place), 0), end) for place, end in zip(high, (width, height), strict=False))
    right, bottom = max(right, left), max(bottom, top)
    return ScreenProjection(
        on_screen,
        (left, top, right, bottom),
        (low[2], high[2]),
        reference,
        0.0 if camera.is_affine else 1 / reference,
        outside_sign,
        *_way_back(camera, reference, np.array([left + right, top + bottom]) / 2),
    )


def _nearest_mm(camera: Camera, vertices: Float32[ndarray, "v 3"]) -> float:
    """The smallest depth that a pinhole sees; not a number where a vertex is not finite."""
    if not np.allclose(camera.matrix[2], camera.matrix[3], rtol=1e-9, atol=0):
        raise DegenerateGeometryError("expected a pinhole whose depth is its w, found another row for each")
    nearest = float(smallest_depth(vertices, camera.matrix[3]))
    if nearest <= 0:
        raise DegenerateGeometryError(
            f"expected the whole face in front of the camera, found vertices down to {nearest:.1f} mm"
        )
    return nearest


def _way_back(
    camera: Camera, reference: float, middle: Float64[ndarray, "2"]
) -> tuple[
    Float64[ndarray, "2"], Float64[ndarray, "3"], Float64[ndarray, "3"], Float64[ndarray, "3"], Float64[ndarray, "3"]
]:
    """Middle, middle_point, along_column, along_row, along_depth."""
    rows = camera.matrix[:3]
    back = np.linalg.inv(rows[:, :3])
    if camera.is_affine:
        point = back @ (np.array([*middle, reference]) - rows[:, 3])
        return middle, point, back[:, 0], back[:, 1], back[:, 2]
    ray = back @ np.array([*middle, 1.0])
    return middle, reference * ray - back @ rows[:, 3], reference * back[:, 0], reference * back[:, 1], ray
