"""The packaged detector: a small network that was trained on rendered people alone finds the centres of faces.

Pictures are scaled so that their longer side has a bounded length, so time does not grow with the resolution of a
camera. Faces smaller than a twentieth of the longer side need a finer look (``smallest_face``).
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Final, final

import cv2
import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from pix2face.detectors.centre_decoding import SAME_FACE_OVERLAP, decode
from pix2face.detectors.protocol import DetectedFace, overlap, sure_boxes, without_doubles
from pix2face.geometry.crops import FaceBox, centres_to_integers
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
# Turned pictures are searched unless an upright face has this score.
CONVINCING_SCORE: Final = 1.75
TURNS_DEG: Final = range(45, 360, 45)
# The faces of a turn count if one of them has this score. With 1, pictures of nobody have four times as many false
# boxes.
SURE_IF_TURNED: Final = 1.5
# A face that is upside down can look like an upright one. Where both are found, the turned one must be surer by this.
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
        """All faces found, surest first, also those that are tilted, lie on their side or are upside down.

        If no upright face is convincing, the picture is also searched after turns by multiples of 45°, and the faces of
        the turn with the surest one are added.
        """
        upright = self._upright_candidates(image)
        if _best_score(upright) >= CONVINCING_SCORE:
            return upright
        small = _scaled(image, LONGEST_SIDE_PX)  # also if small faces are wanted: seven turns take long enough
        px_per_px = np.array([image.shape[1] / small.shape[1], image.shape[0] / small.shape[0]])
        turned = max((self._candidates_of_turned(small, turn, px_per_px) for turn in TURNS_DEG), key=_best_score)
        if _best_score(turned) < SURE_IF_TURNED:
            return upright
        clear = [face for face in turned if all(_is_other_or_surer(face, own) for own in upright)]
        return without_doubles([*upright, *clear], SAME_FACE_OVERLAP)

    def _upright_candidates(self, image: UInt8[ndarray, "h w 3"]) -> list[DetectedFace]:
        seen = _scaled(image, self._longest_side_px)
        height, width = seen.shape[:2]
        padded = np.full((1, _up(height), _up(width), 3), GREY, dtype=np.uint8)
        padded[0, :height, :width] = seen
        boxes, scores = decode(self._answers(padded)[0], CENTRE_STRIDE, LEAST_SCORE)
        px_per_px = (image.shape[1] / width, image.shape[0] / height)
        found = zip((boxes * np.tile(px_per_px, 2)).tolist(), (scores / SURE_SCORE).tolist(), strict=True)
        return [DetectedFace(FaceBox(*box), score) for box, score in found]

    def _candidates_of_turned(
        self, small: UInt8[ndarray, "h w 3"], degrees: float, px_per_px: Float64[ndarray, "2"]
    ) -> list[DetectedFace]:
        """The faces that are found if a small picture is turned anticlockwise, in the pixels of the large one."""
        height, width = small.shape[:2]
        side = max(height, width)
        turn = cv2.getRotationMatrix2D((width / 2, height / 2), degrees, 1)
        turn[:, 2] += (side - width) / 2, (side - height) / 2
        back = px_per_px[:, None] * cv2.invertAffineTransform(turn)
        turned = cv2.warpAffine(small, centres_to_integers(turn), (side, side), borderValue=(GREY,) * 3)
        faces = []
        for face in self._upright_candidates(turned):
            centre = back @ [*face.box.centre, 1]
            # As the box around an ellipse, which faces nearly are.
            half = np.hypot(back[:, 0] * face.box.width, back[:, 1] * face.box.height) / 2
            (left, top), (right, bottom) = (centre - half).tolist(), (centre + half).tolist()
            faces.append(DetectedFace(FaceBox(left, top, right, bottom, degrees), face.score))
        return faces


def _is_other_or_surer(turned: DetectedFace, upright: DetectedFace) -> bool:
    return overlap(turned.box, upright.box) <= SAME_FACE_OVERLAP or turned.score >= upright.score + SURER_BY


def _best_score(faces: Sequence[DetectedFace]) -> float:
    return max((face.score for face in faces), default=0.0)


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
