"""The detectors by name. `pix2face.detectors.protocol` defines what a detector is.

Deviation from the paper: it uses dlib's max-margin CNN ("dlib" here, an extra). The default is the packaged network
"cnn", which needs no download.
"""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Final

from pix2face.detectors.centre_detector import CentreDetector
from pix2face.detectors.dlib_cnn import DlibCnnDetector
from pix2face.detectors.protocol import DetectedFace, Detector
from pix2face.errors import UsageError

__all__ = ["DEFAULT_DETECTOR", "DETECTORS", "DetectedFace", "Detector", "open_detector"]

DETECTORS: Final[Mapping[str, Callable[[], Detector]]] = {
    "cnn": CentreDetector.load,
    "dlib": DlibCnnDetector,
}
DEFAULT_DETECTOR: Final = "cnn"


@cache
def open_detector(name: str = DEFAULT_DETECTOR) -> Detector:
    """Opens a detector. The same name always returns the same object.

    Args:
        name: "cnn" (the default: a small network that was trained on rendered people alone) or "dlib" (the paper's;
            extra ``dlib``).

    Raises:
        UsageError: The name is unknown, or what the detector needs is not installed.
    """
    if name not in DETECTORS:
        raise UsageError(f"expected a detector of {', '.join(DETECTORS)}, found {name!r}")
    return DETECTORS[name]()
