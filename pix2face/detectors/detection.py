"""The detectors by name, or by the file of a network. `pix2face.detectors.protocol` defines what a detector is.

Deviation from the paper: it uses dlib's max-margin CNN ("dlib" here, an extra). The default is the packaged network
"cnn", which needs no download.
"""

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Final

from pix2face.detectors import DEFAULT_DETECTOR
from pix2face.detectors.centre_detector import CentreDetector
from pix2face.detectors.dlib_cnn import DlibCnnDetector
from pix2face.detectors.protocol import DetectedFace, Detector
from pix2face.errors import UsageError

__all__ = ["DETECTORS", "DetectedFace", "Detector", "open_detector"]

# From the smallest face that is looked for, as in ``open_detector``.
DETECTORS: Final[Mapping[str, Callable[[float | None], Detector]]] = {
    "cnn": lambda smallest_face: CentreDetector.load(smallest_face=smallest_face),
    "dlib": DlibCnnDetector,
}
DETECTOR_SUFFIXES: Final = (".safetensors", ".onnx")


@cache
def open_detector(name: str = DEFAULT_DETECTOR, smallest_face: float | None = None) -> Detector:
    """Opens a detector. The same arguments always return the same object.

    Args:
        name: "cnn" (the default: a small network that was trained on rendered people alone) or "dlib" (the paper's;
            extra ``dlib``); or the path of a file that `train detector` (.safetensors) or `pix2face export --detector`
            (.onnx) wrote.
        smallest_face: Longer side of the smallest faces to be found, as a share of the picture's longer side. Time
            grows with its inverse square, up to a limit. None is what the detector finds in little time: a 20th for
            "cnn", a twelfth for "dlib".

    Raises:
        InputFileError: The file is missing or unusable.
        UsageError: The name is unknown, the share is not above 0 and at most 1, or what the detector needs is not
            installed.
    """
    is_file = name.lower().endswith(DETECTOR_SUFFIXES)
    if name not in DETECTORS and not is_file:
        files = " or ".join(DETECTOR_SUFFIXES)
        raise UsageError(f"expected a detector of {', '.join(DETECTORS)}, or a file ({files}), found {name!r}")
    if smallest_face is not None and not 0 < smallest_face <= 1:
        raise UsageError(
            "expected the smallest face as a share of the picture's longer side, above 0 and at most 1 "
            f"(--smallest-face 0.02), found {smallest_face:g}"
        )
    return CentreDetector.load(Path(name), smallest_face) if is_file else DETECTORS[name](smallest_face)
