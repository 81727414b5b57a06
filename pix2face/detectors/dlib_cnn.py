"""dlib's max-margin CNN, the detector of the paper: extra ``dlib``.

The weights, ``mmod_human_face_detector.dat``, come with the package ``face_recognition_models``. Davis King trained
them on faces from many public sets and gave them to the public domain (CC0), as he says in his repository
``dlib-models``; the package itself is under MIT. The package is searched, never imported: importing it needs
``pkg_resources``, which new installations of Python lack.

Source: King 2015, Max-Margin Object Detection; Crispell and Bazik 2017, Section 4.2.
"""

import importlib
import importlib.util
from pathlib import Path
from threading import Lock
from typing import Any, final

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.detectors.protocol import DetectedFace, sure_boxes
from pix2face.errors import UsageError
from pix2face.geometry.crops import FaceBox

WEIGHTS_PACKAGE = "face_recognition_models"
WEIGHTS_FILE = Path("models/mmod_human_face_detector.dat")
HOW_TO_INSTALL = "pip install 'pix2face[dlib]' (that is: pip install dlib-bin face_recognition_models)"

# The tight box of the 68 landmarks in dlib's square window, in units of its side: from the centre of the window to that
# of the box (right, down), and width and height. Medians over the annotated faces of dlib's example photographs
# (`python -m tests.benchmarks.detection`); to the right, the mean with their mirror images, so that what is left is the
# detector's, not the faces'.
SHIFT, EXTENT = np.array([0.04, 0.17]), np.array([0.92, 0.9])

# The network sees faces of 80 px and more. Pictures are brought to this length of their longer side, so that faces of
# a twelfth of it are found whatever the camera's resolution; time grows with the square.
SMALLEST_SEEN_PX = 80
LONGEST_SIDE_PX = 1000
LARGEST_SIDE_PX = 2000  # the longest that a smallest face can ask for: four times the time and the memory
LARGEST_ENLARGEMENT = 4.0  # of a tiny picture: beyond, there is nothing left to see
LEAST_SIDE_PX = 40  # half a face; dlib's filters do not fit into less than half of this


@final
class DlibCnnDetector:
    """dlib's max-margin CNN, calibrated to ``FaceBox``.

    Args:
        smallest_face: Longer side of the smallest faces to be found, as a share of the picture's longer side. None
            takes what ``LONGEST_SIDE_PX`` finds.

    Raises:
        UsageError: dlib or its weights are not installed.
    """

    def __init__(self, smallest_face: float | None = None) -> None:
        wanted = LONGEST_SIDE_PX if smallest_face is None else SMALLEST_SEEN_PX / smallest_face
        self._longest_side_px = min(wanted, LARGEST_SIDE_PX)
        self._find_faces = _load_network(_find_weights())
        self._one_at_a_time = Lock()  # dlib's networks keep what they computed

    def detect(self, image: UInt8[ndarray, "h w 3"]) -> list[FaceBox]:
        """The faces of an RGB picture, largest first, in its pixels; empty where there is none."""
        return sure_boxes(self.candidates(image))

    def candidates(self, image: UInt8[ndarray, "h w 3"]) -> list[DetectedFace]:
        """The same faces with their scores, surest first. dlib reports no doubtful ones."""
        scale = min(self._longest_side_px / max(image.shape[:2]), LARGEST_ENLARGEMENT)
        size = (max(round(image.shape[1] * scale), 1), max(round(image.shape[0] * scale), 1))
        if min(size) < LEAST_SIDE_PX:
            return []
        seen = cv2.resize(image, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR)
        with self._one_at_a_time:
            rectangles = self._find_faces(np.ascontiguousarray(seen), 0)
        faces = []
        for found in rectangles:
            ends, side = found.rect, found.rect.width() / scale
            # dlib's rectangles include their last pixel.
            middle = (
                np.array([ends.left() + ends.right() + 1, ends.top() + ends.bottom() + 1]) / 2 / scale + SHIFT * side
            )
            low, high = middle - EXTENT * side / 2, middle + EXTENT * side / 2
            faces.append(DetectedFace(FaceBox(*low.tolist(), *high.tolist()), 1 + max(float(found.confidence), 0.0)))
        return sorted(faces, key=lambda face: -face.score)


def _find_weights() -> Path:
    spec = importlib.util.find_spec(WEIGHTS_PACKAGE)
    folders = spec.submodule_search_locations if spec is not None else None
    for folder in folders or ():
        if (Path(folder) / WEIGHTS_FILE).is_file():
            return Path(folder) / WEIGHTS_FILE
    raise UsageError(
        f"the detector dlib needs {WEIGHTS_FILE.name} of the package {WEIGHTS_PACKAGE}, found none: {HOW_TO_INSTALL}"
    )


def _load_network(weights: Path) -> Any:
    try:
        dlib = importlib.import_module("dlib")
    except ImportError as error:
        raise UsageError(f"the detector dlib needs the package dlib-bin, found none: {HOW_TO_INSTALL}") from error
    try:
        return dlib.cnn_face_detection_model_v1(str(weights))
    except RuntimeError as error:
        raise UsageError(f"{weights}: expected weights of dlib's face detector, found: {error}") from error
