"""Face detectors, one in each file. All return boxes that are calibrated to `FaceBox`."""

from typing import Final

DEFAULT_DETECTOR: Final = "cnn"
