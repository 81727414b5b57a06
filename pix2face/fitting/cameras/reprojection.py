"""Rows of the linear system that hold the fitted mesh to the pixels where its vertices were found."""

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from pix2face.fitting.least_squares.linear_system import ImageSystem
from pix2face.fitting.localise import VertexPixels
from pix2face.geometry.camera import Camera, nearest_weak_perspective


def with_reprojection(
    camera: Camera,
    mean: Float[ndarray, "n 3"],
    basis: Float[ndarray, "n 3 c"],
    found: VertexPixels,
    system: ImageSystem,
) -> ImageSystem:
    """Adds two rows for each found vertex: where it projects to should be where it was found.

    The offsets alone never look at the picture again: what they get wrong across the viewing direction, the places of
    the vertices know. Rows are divided by the scale of the camera, so that they are millimetres as the others are, and
    weigh the same.

    The camera is fitted to the mesh so far; mean (mm) and basis (mm per standard deviation) are those of the found
    vertices; the system of the offsets has their weights.

    Returns:
        The system with the rows added to those of the offsets alone (not to those of an earlier round).
    """
    derivative, images = _projection(camera, mean.astype(np.float64))
    scale = nearest_weak_perspective(camera).scale
    roots = np.sqrt(system.weights)[:, None]
    weighted = (derivative * (roots / scale)[:, :, None]).astype(basis.dtype)
    rows = (weighted @ basis).reshape(-1, basis.shape[2])
    targets = ((found.points2d - images) * (roots / scale)).reshape(-1).astype(basis.dtype)
    offsets = system.offsets_only or system
    return ImageSystem(
        offsets.normal + rows.T @ rows, offsets.right + targets @ rows, system.weights, offsets_only=offsets
    )


def _projection(
    camera: Camera, points: Float64[ndarray, "n 3"]
) -> tuple[Float64[ndarray, "n 2 3"], Float64[ndarray, "n 2"]]:
    """Derivative of the image (px) with respect to the point (mm), and the image."""
    images = camera.project(points)
    matrix = camera.matrix
    w = points @ matrix[3, :3] + matrix[3, 3]
    derivative = (matrix[None, :2, :3] - images[:, :, None] * matrix[3, :3]) / w[:, None, None]
    return derivative, images
