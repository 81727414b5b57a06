"""From a network's answers for the cells of a picture to boxes of faces."""

import cv2
import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

MOST_FACES = 1000  # of one picture, before those of the same face are put together
SAME_FACE_OVERLAP = 0.4  # of two boxes, in shares of their union
# A small face inside a large one is a part of it taken for a face: more of it than this lies within.
INSIDE = 0.8


def decode(
    planes: Float32[ndarray, "y x 5"], stride_px: int, least_score: float
) -> tuple[Float64[ndarray, "n 4"], Float64[ndarray, " n"]]:
    """The boxes (left, top, right, bottom) and scores of a picture, surest first, one for each face.

    Args:
        planes: As ``training.detection.centre_network.CentreNetwork`` answers.
        stride_px: Pixels of a cell.
        least_score: Probability below which no cell is looked at.
    """
    scores = 1 / (1 + np.exp(-planes[..., 0].astype(np.float64)))
    is_peak = (scores >= least_score) & (scores == cv2.dilate(scores, np.ones((3, 3))))
    rows, columns = np.nonzero(is_peak)
    order = np.argsort(-scores[rows, columns], kind="stable")[:MOST_FACES]
    rows, columns = rows[order], columns[order]
    boxes = stride_px * _voted(planes, scores, rows, columns)
    kept = _without_doubles(boxes)
    return boxes[kept], scores[rows, columns][kept]


def _voted(
    planes: Float32[ndarray, "y x 5"], scores: Float64[ndarray, "y x"], rows: ndarray, columns: ndarray
) -> Float64[ndarray, "n 4"]:
    """Boxes in cells: the mean of what a peak and its neighbours say, by their scores."""
    total, weights = np.zeros((len(rows), 4)), np.zeros((len(rows), 1))
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            row, column = rows + down, columns + right
            inside = (row >= 0) & (row < len(planes)) & (column >= 0) & (column < planes.shape[1])
            row, column = row.clip(0, len(planes) - 1), column.clip(0, planes.shape[1] - 1)
            weight = (scores[row, column] * inside)[:, None] ** 2
            cell = planes[row, column].astype(np.float64)
            centre = cell[:, 1:3] + np.column_stack([column, row]) + 0.5
            half = np.exp(np.clip(cell[:, 3:], -5, 8)) / 2
            total += weight * np.hstack([centre - half, centre + half])
            weights += weight
    return total / np.maximum(weights, 1e-12)


def _without_doubles(boxes: Float64[ndarray, "n 4"]) -> list[int]:
    """The places of the boxes that no earlier one of them overlaps too much."""
    areas = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
    kept: list[int] = []
    for place, box in enumerate(boxes):
        low, high = np.maximum(boxes[kept, :2], box[:2]), np.minimum(boxes[kept, 2:], box[2:])
        common = np.prod(np.clip(high - low, 0, None), axis=1)
        union = areas[kept] + areas[place] - common
        within = common / np.maximum(np.minimum(areas[kept], areas[place]), 1e-12)
        if not ((common > SAME_FACE_OVERLAP * union) | (within > INSIDE)).any():
            kept.append(place)
    return kept
