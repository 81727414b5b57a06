"""Counts samples, of shards and of tables. No picture is decoded, so a set may be larger than the memory."""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from datagen.inspection.dataset_statistics import QUANTITIES, CoefficientStatistics, DatasetStatistics, Histogram
from datagen.sampling.expressions import NAMED_EXPRESSIONS, strengths_of, without_side
from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.geometry.camera import Camera, HeadPose, head_pose
from pix2face.geometry.crops import FaceBox
from pix2face.shards.sample_filter import SampleFilter
from pix2face.shards.sample_truth import doubts_about
from pix2face.shards.shard_reader import ShardReader, shard_paths

FAR_SD = 3.0
# A text attribute with more values than this is a name, not a kind.
LARGEST_KINDS = 200
# A named expression of this strength is clearly to be seen.
ACTIVE = 0.1


@final
@dataclass(eq=False)
class SampleCounter:
    """Counts samples one by one. What a sample lacks is not counted."""

    n: int = 0
    sizes: Counter[str] = field(default_factory=Counter)
    quantities: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in QUANTITIES})
    squares: dict[str, ndarray] = field(default_factory=dict)
    far: dict[str, ndarray] = field(default_factory=dict)
    largest: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    n_with_landmarks: int = 0
    visible: ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    kinds: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    numbers: dict[str, tuple[float, float, float, int]] = field(default_factory=dict)
    doubtful: list[tuple[str, str]] = field(default_factory=list)

    def add_size(self, height_px: int, width_px: int) -> None:
        """Counts the size of a picture; 0 is unknown."""
        if height_px:
            self.sizes[f"{width_px} x {height_px}"] += 1

    def add_pose(self, pose: HeadPose) -> None:
        """Counts the pose of a face."""
        for name, value in (("pitch", pose.pitch_deg), ("yaw", pose.yaw_deg), ("roll", pose.roll_deg)):
            self.quantities[name].append(value)

    def add_face(
        self,
        sample_id: str,
        camera: Camera,
        identity: Float[ndarray, " k"],
        expression: Float[ndarray, " e"],
        attributes: Mapping[str, str | float],
    ) -> None:
        """Counts one sample: its pose, coefficients and attributes.

        Raises:
            UsageError: It has other numbers of coefficients than the samples before.
        """
        self.n += 1
        with suppress(DegenerateGeometryError):
            self.add_pose(head_pose(camera))
        self._add_coefficients("identity", identity, sample_id)
        self._add_coefficients("expression", expression, sample_id)
        self._add_attributes(attributes)

    def add_doubts(self, sample_id: str, doubts: Iterable[str]) -> None:
        """Counts why the ground truth of a sample cannot be true."""
        self.doubtful += [(sample_id, doubt) for doubt in doubts]

    def add_landmarks(self, sample_id: str, landmarks2d: Float[ndarray, "m 2"], visible: Bool[ndarray, " m"]) -> None:
        """Counts the landmarks of a sample, and the longer side of their box as the face's size.

        Raises:
            UsageError: It has another number of landmarks than the samples before.
        """
        with suppress(DegenerateGeometryError):
            self.quantities["face size"].append(FaceBox.around(landmarks2d).longer_side)
        if len(visible):
            if not self.n_with_landmarks:
                self.visible = np.zeros(len(visible), np.int64)
            _check_number(sample_id, "landmarks", len(self.visible), len(visible))
            self.n_with_landmarks += 1
            self.visible += visible

    def finish(self, n_shards: int = 0) -> DatasetStatistics:
        """The statistics of all samples so far."""
        histograms = [
            Histogram.of(name, np.array(values), self.n) for name, values in self.quantities.items() if values
        ]
        coefficients = [
            CoefficientStatistics(name, np.sqrt(squares / self.n), self.far[name] / self.n, self.largest[name])
            for name, squares in self.squares.items()
        ]
        kinds = {
            name: dict(counter.most_common()) if len(counter) <= LARGEST_KINDS else {}
            for name, counter in sorted(self.kinds.items())
        }
        numbers = {name: (low, total / n, high) for name, (low, total, high, n) in sorted(self.numbers.items())}
        return DatasetStatistics(
            n_samples=self.n,
            n_shards=n_shards,
            picture_sizes=dict(self.sizes.most_common()),
            histograms=tuple(histograms),
            coefficients=tuple(coefficients),
            visible_share=self.visible / max(self.n_with_landmarks, 1),
            kinds=kinds,
            numbers=numbers,
            doubtful=tuple(self.doubtful),
        )

    def _add_coefficients(self, name: str, values: Float[ndarray, " k"], sample_id: str) -> None:
        squares = self.squares.setdefault(name, np.zeros(len(values)))
        _check_number(sample_id, "coefficients", len(squares), len(values))
        squares += values.astype(np.float64) ** 2
        self.far.setdefault(name, np.zeros(len(values), np.int64))
        self.far[name] += np.abs(values) > FAR_SD
        self.largest[name] = max(self.largest[name], float(np.abs(values).max(initial=0)))

    def _add_attributes(self, attributes: Mapping[str, str | float]) -> None:
        for name, value in attributes.items():
            if name == NAMED_EXPRESSIONS:
                self.kinds[f"{name}, {ACTIVE} or more"].update(_active_expressions(attributes))
            elif isinstance(value, str):
                if name == "expression":
                    self.kinds["expression, kind"][value.partition("/")[0]] += 1
                if len(self.kinds[name]) <= LARGEST_KINDS:
                    self.kinds[name][value] += 1
            elif np.isfinite(value):
                smallest, total, largest, n = self.numbers.get(name, (np.inf, 0.0, -np.inf, 0))
                self.numbers[name] = (min(smallest, value), total + value, max(largest, value), n + 1)
        if "distance_mm" in attributes:
            self.quantities["distance"].append(float(attributes["distance_mm"]))


def count_samples(shards: Path, on_shard: Callable[[], None] = lambda: None, where: str = "") -> DatasetStatistics:
    """Counts the samples of a folder of shards whose attributes fulfil a condition; an empty one counts all.

    ``on_shard`` is called after each shard; ``pix2face.shards.sample_filter`` describes conditions (``where``).

    Raises:
        UsageError: There are no shards, no samples to count in them, or samples of different models.
        InputFileError: A shard cannot be read.
    """
    paths, counter = shard_paths(shards), SampleCounter()
    chosen = SampleFilter(where, "--where") if where.strip() else None
    for path in paths:
        reader = ShardReader(path)
        for index in range(len(reader)):
            sample = reader.read(index, ())
            if chosen is None or chosen.passes(sample.sample_id, sample.attributes):
                counter.add_size(*reader.size_px(index))
                counter.add_face(sample.sample_id, sample.camera, sample.identity, sample.expression, sample.attributes)
                counter.add_landmarks(sample.sample_id, sample.landmarks2d, sample.visible)
                counter.add_doubts(sample.sample_id, doubts_about(sample, reader.size_px(index)))
        on_shard()
    if chosen is not None:
        chosen.check_names()
    if not counter.n:
        if where.strip():
            raise UsageError(f"{shards}: expected samples that --where lets pass, found none; leave it out to see all")
        raise UsageError(f"{shards}: expected samples to count, found empty shards; see rejected.jsonl for the reasons")
    return counter.finish(len(paths))


def _check_number(sample_id: str, what: str, expected: int, found: int) -> None:
    if expected != found:
        raise UsageError(
            f"{sample_id}: expected {expected} {what} as in the samples before, found {found}; "
            "count the shards of one model at a time"
        )


def _active_expressions(attributes: Mapping[str, str | float]) -> list[str]:
    """Named expressions that are clearly to be seen, always in the same order; one of both sides counts once."""
    with suppress(ValueError, TypeError, AttributeError):  # a text that another program wrote
        return sorted({without_side(name) for name, strength in strengths_of(attributes).items() if strength >= ACTIVE})
    return []
