"""The packaged detector: a small network that was trained on rendered people alone finds the centres of faces.

Pictures are scaled so that their longer side has a bounded length, so time does not grow with the resolution of a
camera. Faces smaller than a twentieth of the longer side need a finer look (``smallest_face``).
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Final, final

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.detectors.centre_decoding import decode
from pix2face.detectors.protocol import DetectedFace, sure_boxes
from pix2face.geometry.crops import FaceBox
from pix2face.inference.centre_files import CentreAnswers, load_detector
from pix2face.networks.dimensions import CENTRE_MULTIPLE, CENTRE_STRIDE

PACKAGED: Final = Path(__file__).parents[1] / "assets" / "detector.safetensors"
LONGEST_SIDE_PX: Final = 240  # chosen on 400 images of AFLW2000-3D; 224 to 288 px find 392 to 397 of their faces
LARGEST_SIDE_PX: Final = 1280  # the longest that a smallest face can ask for
SMALLEST_SEEN_PX: Final = 12.0  # the smallest face that the network finds
LARGEST_ENLARGEMENT: Final = 2.0
LEAST_SAMPLES: Final = 4  # pixels across of a larger picture that a pixel of the scaled one is the mean of
LEAST_SCORE: Final = 0.05  # candidates below are not even listed
SURE_SCORE: Final = 0.4
# An upright face with this score is not doubted. Any other counts as turned if a turned picture has a face that is
# surer by so much. Of 439 upright photographs of AFLW2000-3D, 300-W and dlib, one does: its face is turned by 64°.
CONVINCING_SCORE: Final = 1.75
SURER_BY: Final = 0.6
GREY: Final = 128  # what the network takes for nothing


@final
class CentreDetector:
    """Finds faces by a network of ``training.detection.centre_network``.

    Args:
        answers: The network.
        smallest_face: Longer side of the smallest faces to be found, as a share of the picture's longer side; finer
            looks take longer, with the square of it. None takes what ``LONGEST_SIDE_PX`` finds.
    """

    def __init__(self, answers: CentreAnswers, smallest_face: float | None = None) -> None:
        self._answers = answers
        wanted = LONGEST_SIDE_PX if smallest_face is None else SMALLEST_SEEN_PX / smallest_face
        self._longest_side_px = float(np.clip(wanted, LONGEST_SIDE_PX, LARGEST_SIDE_PX))

    @classmethod
    def load(cls, path: Path = PACKAGED, smallest_face: float | None = None) -> "CentreDetector":
        """Opens a network that ``train detector`` wrote.

        Raises:
            InputFileError: The file is missing or unusable.
        """
        return cls(load_detector(path)[1], smallest_face)

    def detect(self, image: UInt8[ndarray, "h w 3"]) -> list[FaceBox]:
        """The faces of an RGB picture, largest first, in its pixels; empty where there is none."""
        return sure_boxes(self.candidates(image))

    def candidates(self, image: UInt8[ndarray, "h w 3"]) -> list[DetectedFace]:
        """All faces found, surest first."""
        return self.candidates_of_batch([image])[0]

    def candidates_of_batch(self, images: Sequence[UInt8[ndarray, "_ _ 3"]]) -> list[list[DetectedFace]]:
        """All faces of each picture, surest first. The pictures of one size go through the network together."""
        seen = [_scaled(image, self._longest_side_px) for image in images]
        places_by_shape: dict[tuple[int, ...], list[int]] = {}
        for place, picture in enumerate(seen):
            places_by_shape.setdefault(picture.shape, []).append(place)
        found: list[list[DetectedFace]] = [[] for _ in images]
        for (height, width, _), places in places_by_shape.items():
            batch = np.full((len(places), _up(height), _up(width), 3), GREY, dtype=np.uint8)
            batch[:, :height, :width] = [seen[place] for place in places]
            for place, planes in zip(places, self._answers(batch), strict=True):
                boxes, scores = decode(planes, CENTRE_STRIDE, LEAST_SCORE)
                px_per_px = (images[place].shape[1] / width, images[place].shape[0] / height)
                own = zip((boxes * np.tile(px_per_px, 2)).tolist(), (scores / SURE_SCORE).tolist(), strict=True)
                found[place] = [DetectedFace(FaceBox(*box), score) for box, score in own]
        return found

    def candidates_any_way_up(self, image: UInt8[ndarray, "h w 3"]) -> list[DetectedFace]:
        """All faces found, surest first, also if the picture lies on its side or is upside down.

        If no upright face is convincing, the picture is also searched after turns of 90°, 180° and 270°. A turn counts
        if its best face is clearly surer: a face that is upside down can look like an upright one.
        """
        upright = self.candidates(image)
        best = _best_score(upright)
        if best >= CONVINCING_SCORE:
            return upright
        small = _scaled(image, self._longest_side_px)
        found = {turns: self.candidates(np.ascontiguousarray(np.rot90(small, turns))) for turns in (1, 2, 3)}
        turns = max(found, key=lambda own: _best_score(found[own]))
        if _best_score(found[turns]) < max(best + SURER_BY, 1.0):
            return upright
        px_per_px = image.shape[1] / small.shape[1], image.shape[0] / small.shape[0]
        return [
            DetectedFace(_turned_back(face.box, turns, small.shape, px_per_px), face.score) for face in found[turns]
        ]


def _best_score(faces: Sequence[DetectedFace]) -> float:
    return max((face.score for face in faces), default=0.0)


def _turned_back(box: FaceBox, turns: int, shape: tuple[int, ...], px_per_px: tuple[float, float]) -> FaceBox:
    """The box in a picture of this shape of one in ``np.rot90(picture, turns)``, in pixels of another size."""
    x, y = np.array([box.left, box.right]), np.array([box.top, box.bottom])
    for turn in reversed(range(turns)):
        x, y = shape[1 - turn % 2] - y, x
    x, y = np.sort(x) * px_per_px[0], np.sort(y) * px_per_px[1]
    return FaceBox(float(x[0]), float(y[0]), float(x[1]), float(y[1]))


def _scaled(image: UInt8[ndarray, "h w 3"], longest_side_px: float) -> UInt8[ndarray, "_ _ 3"]:
    """The picture with a longer side of this length, or enlarged as far as there is something to see."""
    scale = min(longest_side_px / max(image.shape[:2]), LARGEST_ENLARGEMENT)
    step = min(int(1 / (scale * LEAST_SAMPLES)), *image.shape[:2])
    if step > 1:  # every so-many-th pixel of a large picture tells enough; to read all of them takes most of the time
        image = np.ascontiguousarray(image[step // 2 :: step, step // 2 :: step])
        scale = longest_side_px / max(image.shape[:2])
    size = (max(round(image.shape[1] * scale), 1), max(round(image.shape[0] * scale), 1))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR))


def _up(extent: int) -> int:
    return -(-extent // CENTRE_MULTIPLE) * CENTRE_MULTIPLE
