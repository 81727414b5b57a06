"""Where a face is looked for when a detector says so: of its boxes the one that fits the true one best, if any does."""

from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

from jaxtyping import UInt8
from numpy import ndarray

from pix2face.detectors.protocol import overlap
from pix2face.errors import DegenerateGeometryError
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFace
from pix2face.geometry.crops import FaceBox

# Intersection over union below which a detector's box is taken for another face, or for none.
LEAST_OVERLAP = 0.3


@runtime_checkable
class BoxDetector(Protocol):
    """Finds faces in a picture."""

    def detect(self, image: UInt8[ndarray, "h w 3"]) -> list[FaceBox]:
        """Their boxes."""


@final
@dataclass(frozen=True, eq=False)
class DetectedBox:
    """The box rule of an evaluation that begins with detection.

    Pictures hold several faces and the benchmark asks for one, so the truth decides which box is meant; it does not
    make the box better.

    Attributes:
        detector: What finds the faces.
        name: Of the detector, for messages.
    """

    detector: BoxDetector
    name: str

    def __call__(self, face: BenchmarkFace) -> FaceBox:
        """The detector's box of a face.

        Raises:
            DegenerateGeometryError: It has none.
        """
        image = face.with_image().image
        assert image is not None
        true_box = FaceBox.around(face.landmarks2d)
        boxes = self.detector.detect(image)
        overlaps = [overlap(box, true_box) for box in boxes]
        if not boxes or max(overlaps) < LEAST_OVERLAP:
            found = f"{len(boxes)} elsewhere" if boxes else "no face"
            raise DegenerateGeometryError(f"detector {self.name}: {found}")
        return boxes[overlaps.index(max(overlaps))]
