"""Which landmarks a picture shows."""

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from pix2face.geometry.camera import Camera
from pix2face.models.rasterise import RenderedMaps

# A landmark is a point of the surface, but the depth at its pixel is taken up to 0.7 px beside it, where a slanting
# cheek is some millimetres deeper; what hides a landmark (nose, jaw, the other half of the head) is farther away.
TOLERANCE_MM = 3.0


def visible_landmarks(
    vertices: Float[ndarray, "v 3"], landmarks: Int[ndarray, " m"], camera: Camera, rendered: RenderedMaps
) -> Bool[ndarray, " m"]:
    """Which landmarks lie in the image and on its nearest surface.

    Args:
        vertices: This face, mm, model frame.
        landmarks: Vertex of each landmark.
        camera: What ``rendered`` was seen through.
        rendered: For its ``surface_depth``: hair, neck and the inside of the head hide as well.
    """
    points = vertices[landmarks]
    height, width = rendered.surface_depth.shape
    column, row = np.floor(camera.project(points)).astype(np.int64).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    surface = rendered.surface_depth[np.where(inside, row, 0), np.where(inside, column, 0)]
    # At the silhouette the centre of the landmark's own pixel may be background (inf): it counts as seen.
    return np.asarray(inside & (camera.depth(points) < surface + TOLERANCE_MM))
