"""Where edges lie: those of pictures against those of maps drawn finer."""

import cv2
import numpy as np
from numpy import ndarray

from datagen.rendering.renderer import Renderer
from pix2face.geometry.camera import Camera

FINER = 8


def true_coverage(renderer: Renderer, vertices: ndarray, camera: Camera) -> tuple[ndarray, ndarray]:
    """Of the head and of the face mask, by a renderer of pictures ``FINER`` times as large in both directions."""
    maps = renderer.render(vertices, camera.transformed(np.diag([FINER, FINER, 1.0])))
    size = tuple(side // FINER for side in reversed(maps["mask"].shape))
    parts = (np.isfinite(maps["surface_depth"]), maps["mask"] > 0)
    head, face = (cv2.resize(part.astype(np.float32), size, interpolation=cv2.INTER_AREA) for part in parts)
    return head, face


def edge_offsets(found: ndarray, truth: ndarray, where: ndarray) -> ndarray:
    """How far the edge of ``found`` lies outside that of ``truth`` along the edge's normal, px."""
    wide = [cv2.GaussianBlur(each, (0, 0), 1.2) for each in (found, truth)]
    slope = np.hypot(np.gradient(wide[1], axis=0), np.gradient(wide[1], axis=1))
    at_edge = where & (slope > 0.2) & (np.abs(wide[1] - 0.5) < 0.25)
    return ((wide[0] - wide[1]) / np.maximum(slope, 1e-6))[at_edge]
