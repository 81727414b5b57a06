"""Looks for the faces of a benchmark with a detector, as `pix2face fit` does, and holds the boxes against the truth."""

import time
from dataclasses import dataclass
from typing import final

from pix2face.detectors import SURE_SCORE
from pix2face.detectors.detection import DetectedFace, Detector
from pix2face.detectors.protocol import overlap, sure_faces
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFace
from pix2face.evaluation.figures.detection_summary import FaceDetection, is_of_face
from pix2face.geometry.crops import FaceBox
from pix2face.inference.predictor import Predictor
from pix2face.models.morphable_model import MorphableModel
from pix2face.photographs.refined_detection import refine_faces


@final
@dataclass(frozen=True, eq=False)
class FaceSearch:
    """A detector and what is done with its boxes."""

    detector: Detector
    predictor: Predictor | None = None  # corrects and rejects boxes; None uses them as they are
    model: MorphableModel | None = None  # of the predictor
    min_score: float = SURE_SCORE  # of the faces that count

    def find(self, face: BenchmarkFace) -> FaceDetection:
        """Looks for the annotated face.

        A picture may show several faces, and the benchmark asks for one of them. The truth decides only which of the
        boxes is meant: of those that find the face, the one that overlaps the true box most.
        """
        image = face.with_image().image
        assert image is not None
        started = time.perf_counter()
        candidates = self.detector.candidates(image)
        detected = time.perf_counter()
        faces = sure_faces(candidates, self.min_score)
        if self.predictor is not None and self.model is not None:
            faces = refine_faces(image, faces, self.predictor, self.model)
        done = time.perf_counter()
        truth = FaceBox.around(face.landmarks2d)
        hits = [own for own in faces if is_of_face(own.box, truth)]
        best = max(hits, key=lambda own: overlap(own.box, truth), default=None)
        return FaceDetection(
            box=None if best is None else best.box,
            score=None if best is None else best.score,
            overlap=None if best is None else overlap(best.box, truth),
            n_false=len(faces) - (best is not None),
            candidates=_hits(candidates, truth),
            true_size_px=truth.longer_side,
            detection_ms=1000 * (detected - started),
            whole_ms=1000 * (done - started),
        )


def _hits(candidates: list[DetectedFace], truth: FaceBox) -> tuple[tuple[float, bool], ...]:
    """The scores of the candidates, and which one is the face: the surest that finds it. A second one is false."""
    ordered = sorted(candidates, key=lambda own: -own.score)
    first = next((index for index, own in enumerate(ordered) if is_of_face(own.box, truth)), None)
    return tuple((float(own.score), index == first) for index, own in enumerate(ordered))
