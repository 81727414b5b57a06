"""The detectors by name. `pix2face.detectors.protocol` defines what a detector is.

Deviation from the paper: it uses dlib's max-margin CNN ("dlib" here, an extra); the default is the packed LBP cascade
that scikit-image ships, which needs no download. Profiles escape it, but not the small network "cnn".
"""

from collections.abc import Callable, Mapping
from functools import cache
from typing import Final

from pix2face.detectors.dlib_cnn import DlibCnnDetector
from pix2face.detectors.lbp_cascade import ONE_LOOK, LbpCascadeDetector
from pix2face.detectors.protocol import DetectedFace, Detector
from pix2face.errors import UsageError

__all__ = ["DEFAULT_DETECTOR", "DETECTORS", "DetectedFace", "Detector", "open_detector"]


def _open_cnn() -> Detector:
    from pix2face.detectors.centre_detector import CentreDetector  # loads torch

    return CentreDetector.load()


DETECTORS: Final[Mapping[str, Callable[[], Detector]]] = {
    "lbp": LbpCascadeDetector,
    "lbp-quick": lambda: LbpCascadeDetector(ONE_LOOK),
    "cnn": _open_cnn,
    "dlib": DlibCnnDetector,
}
DEFAULT_DETECTOR: Final = "lbp"


@cache
def open_detector(name: str = DEFAULT_DETECTOR) -> Detector:
    """Opens a detector. The same name always returns the same object.

    Args:
        name: "lbp" (the default), "lbp-quick" (a fifth of its time, fewer faces), "cnn" (a small network that was
            trained on rendered people alone), or "dlib" (the paper's; extra ``dlib``).

    Raises:
        UsageError: The name is unknown, or what the detector needs is not installed.
    """
    if name not in DETECTORS:
        raise UsageError(f"expected a detector of {', '.join(DETECTORS)}, found {name!r}")
    return DETECTORS[name]()
