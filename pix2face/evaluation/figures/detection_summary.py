"""How well a detector finds the annotated faces of a benchmark: recall, false boxes, overlap, precision and time."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float64
from numpy import ndarray

from pix2face.evaluation.benchmarks.benchmark_data import YAW_BINS, yaw_bin
from pix2face.geometry.crops import FaceBox

# Longer side of the true box, pixels: lower bounds of the bins.
SIZE_EDGES_PX = (0, 16, 32, 64, 128, 256, 512)
LARGEST_RATIO_OF_SIZES = 2.0
MOST_CURVE_POINTS = 200


def is_of_face(box: FaceBox, true_box: FaceBox) -> bool:
    """Whether a box finds a face: its centre lies in the true box, and its size is within a factor of 2 of that one's.

    The size of a box is its longer side.
    """
    x, y = box.centre
    is_inside = true_box.left <= x <= true_box.right and true_box.top <= y <= true_box.bottom
    ratio = box.longer_side / true_box.longer_side if true_box.longer_side > 0 else np.inf
    return bool(is_inside and 1 / LARGEST_RATIO_OF_SIZES <= ratio <= LARGEST_RATIO_OF_SIZES)


@final
@dataclass(frozen=True)
class FaceDetection:
    """What a detector says of a photograph of which one face is annotated."""

    box: FaceBox | None  # where the network looks; None where the face was not found
    score: float | None  # of this face
    overlap: float | None  # intersection over union with the true box
    n_false: int  # boxes in use that are not of the face
    candidates: tuple[tuple[float, bool], ...]  # of all candidates: score, and whether this is the first of the face
    true_size_px: float  # longer side of the true box
    detection_ms: float  # time that the detector took
    whole_ms: float  # with refinement


@final
@dataclass(frozen=True)
class RecallBin:
    """Faces of one bin."""

    name: str
    n_faces: int
    n_found: int

    @property
    def recall(self) -> float | None:
        """The share of the faces that were found; None without faces."""
        return self.n_found / self.n_faces if self.n_faces else None


@final
@dataclass(frozen=True)
class DetectionSummary:
    """All photographs of a benchmark. Times are medians over the photographs."""

    all_faces: RecallBin
    by_yaw: tuple[RecallBin, ...]  # empty where the truth states no yaw
    by_size: tuple[RecallBin, ...]  # those that have faces
    n_false: int  # boxes in use that are of no annotated face
    n_with_false: int  # photographs with such a box
    median_overlap: float | None  # of the faces found
    lowest_tenth_overlap: float | None
    average_precision: float | None  # area under the curve of precision over recall
    curve: tuple[tuple[float, float, float], ...]  # score, recall and precision if candidates from there on count
    detection_ms: float
    whole_ms: float

    @property
    def false_per_photograph(self) -> float:
        """False boxes a photograph."""
        return self.n_false / self.all_faces.n_faces


def summarise_detections(
    detections: Sequence[FaceDetection | None], yaws_deg: Sequence[float | None]
) -> DetectionSummary | None:
    """Sums up the photographs in which a detector looked for the face; None without any."""
    pairs = [(own, yaw) for own, yaw in zip(detections, yaws_deg, strict=True) if own is not None]
    if not pairs:
        return None
    known = [own for own, _ in pairs]
    is_found = np.array([own.box is not None for own in known])
    overlaps = [own.overlap for own in known if own.overlap is not None]
    bins = np.array(["" if yaw is None else yaw_bin(yaw) for _, yaw in pairs])
    sizes = np.array([own.true_size_px for own in known])
    by_size = [
        _bin(
            f"{low} px and more" if high == np.inf else f"{low} to {high:g} px",
            (sizes >= low) & (sizes < high),
            is_found,
        )
        for low, high in zip(SIZE_EDGES_PX, (*SIZE_EDGES_PX[1:], np.inf), strict=True)
    ]
    curve, average_precision = _precision_over_recall(known)
    return DetectionSummary(
        all_faces=_bin("all", np.ones(len(known), dtype=bool), is_found),
        by_yaw=tuple(_bin(name, bins == name, is_found) for name in YAW_BINS) if (bins != "").any() else (),
        by_size=tuple(own for own in by_size if own.n_faces),
        n_false=sum(own.n_false for own in known),
        n_with_false=sum(own.n_false > 0 for own in known),
        median_overlap=float(np.median(overlaps)) if overlaps else None,
        lowest_tenth_overlap=float(np.percentile(overlaps, 10)) if overlaps else None,
        average_precision=average_precision,
        curve=curve,
        detection_ms=float(np.median([own.detection_ms for own in known])),
        whole_ms=float(np.median([own.whole_ms for own in known])),
    )


def _bin(name: str, is_in: Bool[ndarray, " n"], is_found: Bool[ndarray, " n"]) -> RecallBin:
    return RecallBin(name, int(is_in.sum()), int((is_in & is_found).sum()))


def _precision_over_recall(
    detections: Sequence[FaceDetection],
) -> tuple[tuple[tuple[float, float, float], ...], float | None]:
    """Points of the curve, from the highest score down, and the area under it.

    For the area, the precision at a recall is the best at this recall or beyond, as in PASCAL VOC since 2010.
    """
    candidates = sorted((own for each in detections for own in each.candidates), reverse=True)
    if not candidates:
        return (), None
    scores, hits = np.array([score for score, _ in candidates]), np.array([hit for _, hit in candidates])
    last_of_score = np.append(scores[1:] != scores[:-1], True)
    n_hits: Float64[ndarray, " n"] = np.cumsum(hits).astype(np.float64)
    recall, precision = (n_hits / len(detections))[last_of_score], (n_hits / np.arange(1, len(hits) + 1))[last_of_score]
    best = np.maximum.accumulate(precision[::-1])[::-1]
    area = float(np.sum(np.diff(recall, prepend=0) * best))
    shown = np.unique(np.linspace(0, len(recall) - 1, min(len(recall), MOST_CURVE_POINTS)).round().astype(int))
    points = np.column_stack([scores[last_of_score], recall, precision])[shown]
    return tuple((score, own_recall, own_precision) for score, own_recall, own_precision in points.tolist()), area
