"""The LBP cascade that scikit-image packs: needs no download; finds faces turned to either side by up to some 45°.

The cascade answers yes or no for each of many overlapping windows. How many of them agree is the score: one look at
the picture as it is, one at its mirror image and two at the picture turned by 20° either way find faces that a single
look misses, and a false window seldom comes back in all of them (figures: docs/explanation/detection_and_tracking.md).
"""

from typing import final

import cv2
import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray
from skimage.data import lbp_frontal_face_cascade_filename
from skimage.feature import Cascade

from pix2face.detectors.protocol import DetectedFace, WindowCalibration, box_of_window, sure_boxes
from pix2face.geometry.crops import FaceBox

# Medians over the annotated faces of dlib's example photographs (`python -m tests.benchmarks.detection`). To the right
# it is 0: the picture and its mirror image disagree on the sign.
CALIBRATION = WindowCalibration(shift=(0.0, 0.14), width=0.85, height=0.84)

SMALLEST_WINDOW_PX = 24  # what the cascade was trained on
# Larger pictures are shrunk first: time grows with the area, and one face in them is seldom below 24 of 640 px.
LONGEST_SIDE_PX = 640
STEP_OF_SCALES = 1.15
# Windows that overlap the one with most others by this much (of their union) are its face.
SAME_FACE_OVERLAP = 0.3

# A look: by how much the picture is turned (degrees, positive turns it anticlockwise as seen), and whether mirrored.
Look = tuple[float, bool]
ONE_LOOK: tuple[Look, ...] = ((0.0, False),)
FOUR_LOOKS: tuple[Look, ...] = ((0.0, False), (0.0, True), (-20.0, False), (20.0, False))
# Windows that must agree: 8 or 9 of four looks find 42 of dlib's 43 annotated faces with 2 false boxes, 5 with 24.
SURE_WINDOWS = {ONE_LOOK: 6, FOUR_LOOKS: 9}
LEAST_WINDOWS = {ONE_LOOK: 3, FOUR_LOOKS: 5}


@final
class LbpCascadeDetector:
    """scikit-image's frontal face cascade, calibrated to ``FaceBox``.

    Args:
        looks: ``FOUR_LOOKS`` or, in a quarter of the time and with fewer faces found, ``ONE_LOOK``.
    """

    def __init__(self, looks: tuple[Look, ...] = FOUR_LOOKS) -> None:
        self._cascade = Cascade(lbp_frontal_face_cascade_filename())  # type: ignore[no-untyped-call]
        self._looks = looks

    def detect(self, image: UInt8[ndarray, "h w 3"]) -> list[FaceBox]:
        """The faces of an RGB picture that enough windows agree on, largest first, in its pixels; empty if none."""
        return sure_boxes(self.candidates(image))

    def candidates(self, image: UInt8[ndarray, "h w 3"]) -> list[DetectedFace]:
        """All faces found, including those that few windows agree on, surest first."""
        px_per_px = max(1.0, max(image.shape[:2]) / LONGEST_SIDE_PX)
        small = _shrunk(image, px_per_px)
        windows = np.concatenate([self._windows(small, *look) for look in self._looks])
        groups = _groups(windows * px_per_px, LEAST_WINDOWS[self._looks])
        faces = [
            DetectedFace(box_of_window((x, y), side, CALIBRATION), count / SURE_WINDOWS[self._looks])
            for (x, y, side), count in groups
        ]
        return sorted(faces, key=lambda face: -face.score)

    def _windows(self, image: UInt8[ndarray, "h w 3"], turn_deg: float, mirror: bool) -> Float64[ndarray, "n 3"]:
        """All windows that the cascade takes for a face in one look: (x, y, side) in pixels of the picture.

        The middle is moved from the window's to that of an upright face, then brought back from the look.
        """
        seen_from_image = _look_matrix(image.shape[1], image.shape[0], turn_deg, mirror)
        width, height = _look_size(image.shape[1], image.shape[0], turn_deg)
        if min(width, height) <= SMALLEST_WINDOW_PX:
            return np.zeros((0, 3))
        seen = cv2.warpAffine(image, seen_from_image, (width, height)) if turn_deg or mirror else image
        found = self._cascade.detect_multi_scale(
            img=np.ascontiguousarray(seen),
            scale_factor=STEP_OF_SCALES,
            step_ratio=1,
            min_size=(SMALLEST_WINDOW_PX, SMALLEST_WINDOW_PX),
            max_size=(min(width, height), min(width, height)),
            # No two windows overlap by more than all of their area, so each stays a group of its own: grouping is ours.
            min_neighbor_number=0,
            intersection_score_threshold=1.01,
        )
        windows = np.array([[own["c"], own["r"], own["width"]] for own in found], dtype=np.float64).reshape(-1, 3)
        sides = windows[:, 2]
        up = sides * CALIBRATION.shift[1]
        middles = windows[:, :2] + sides[:, None] / 2 + np.column_stack([np.zeros(len(up)), up])
        image_from_seen = cv2.invertAffineTransform(seen_from_image)
        back = middles @ image_from_seen[:, :2].T + image_from_seen[:, 2]
        return np.column_stack([back - np.column_stack([np.zeros(len(up)), up]), sides])


def _look_size(width: int, height: int, turn_deg: float) -> tuple[int, int]:
    """Width and height of a picture that holds all of the turned one."""
    cos, sin = abs(np.cos(np.deg2rad(turn_deg))), abs(np.sin(np.deg2rad(turn_deg)))
    return round(width * cos + height * sin), round(width * sin + height * cos)


def _look_matrix(width: int, height: int, turn_deg: float, mirror: bool) -> Float64[ndarray, "2 3"]:
    """From pixels of the picture to those of the look, centres at +0.5 (half a pixel is nothing to a detector)."""
    size = np.array(_look_size(width, height, turn_deg))
    matrix = np.asarray(cv2.getRotationMatrix2D((width / 2, height / 2), turn_deg, 1.0), dtype=np.float64)
    matrix[:, 2] += size / 2 - np.array([width, height]) / 2
    if mirror:
        matrix[0] *= -1
        matrix[0, 2] += size[0]
    return matrix


def _groups(windows: Float64[ndarray, "n 3"], at_least: int) -> list[tuple[tuple[float, float, float], int]]:
    """Groups windows around the one that overlaps most others, repeatedly: median and size of each group."""
    groups = []
    similar = _overlaps(windows) > SAME_FACE_OVERLAP
    left = np.ones(len(windows), dtype=bool)
    while left.any():
        counts = np.where(left, (similar & left).sum(axis=1), 0)
        members = similar[int(counts.argmax())] & left
        if members.sum() < at_least:
            break
        x, y, side = np.median(windows[members], axis=0).tolist()
        groups.append(((x, y, side), int(members.sum())))
        left &= ~members
    return groups


def _overlaps(windows: Float64[ndarray, "n 3"]) -> Float64[ndarray, "n n"]:
    """Intersection over union of each two square windows (x, y, side)."""
    low, high = windows[:, :2] - windows[:, 2:] / 2, windows[:, :2] + windows[:, 2:] / 2
    sides = np.minimum(high[:, None], high[None]) - np.maximum(low[:, None], low[None])
    common = np.prod(np.clip(sides, 0, None), axis=2)
    areas = windows[:, 2] ** 2
    return np.asarray(common / np.maximum(areas[:, None] + areas[None] - common, 1e-9), dtype=np.float64)


def _shrunk(image: UInt8[ndarray, "h w 3"], factor: float) -> UInt8[ndarray, "_ _ 3"]:
    if factor == 1:
        return image
    size = (max(round(image.shape[1] / factor), 1), max(round(image.shape[0] / factor), 1))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))
