"""Face detectors, one in each file. All return boxes that are calibrated to `FaceBox`."""

from typing import Final

DEFAULT_DETECTOR: Final = "cnn"
SURE_SCORE: Final = 1.0  # from this score on, a detector is sure of a face
