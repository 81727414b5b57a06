"""Counting the samples of a folder of shards.

Shards are read one after the other and no pixel is decoded, so a set may be larger than the memory.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from datagen.inspection.dataset_statistics import CoefficientStatistics, DatasetStatistics, Histogram
from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.geometry.camera import head_pose
from pix2face.geometry.crops import FaceBox
from pix2face.shards.sample_filter import SampleFilter
from pix2face.shards.shard_reader import ShardReader, Triplet, shard_paths

ANGLE_EDGES = (-180, *range(-90, 91, 15), 180)
SIZE_EDGES = (0, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024, np.inf)
HISTOGRAMS = {"pitch": ANGLE_EDGES, "yaw": ANGLE_EDGES, "roll": ANGLE_EDGES, "face size": SIZE_EDGES}
UNITS = {"pitch": "°", "yaw": "°", "roll": "°", "face size": "px"}
FAR_SD = 3.0
# A text attribute with more values than this is a name, not a kind.
LARGEST_KINDS = 200


def count_samples(shards: Path, on_shard: Callable[[], None] = lambda: None, where: str = "") -> DatasetStatistics:
    """Counts a folder of shards.

    Args:
        shards: The folder.
        on_shard: Called after each shard.
        where: What a sample's attributes must fulfil to be counted (``pix2face.shards.sample_filter``); empty counts
            all.

    Raises:
        UsageError: There are no shards, no samples to count in them, or samples of different models.
        InputFileError: A shard cannot be read.
    """
    paths, counts = shard_paths(shards), _Counts()
    chosen = SampleFilter(where, "--where") if where.strip() else None
    for path in paths:
        with ShardReader(path) as reader:
            for index in range(len(reader)):
                triplet = reader.triplet(index, with_pixels=False)
                if chosen is None or chosen.passes(triplet.sample_id, triplet.attributes):
                    counts.add_size(*reader.size_px(index))
                    counts.add(triplet)
        on_shard()
    if chosen is not None:
        chosen.check_names()
    if not counts.n:
        if where.strip():
            raise UsageError(f"{shards}: expected samples that --where lets pass, found none; leave it out to see all")
        raise UsageError(f"{shards}: expected samples to count, found empty shards; see rejected.jsonl for the reasons")
    return counts.finish(len(paths))


@final
@dataclass(eq=False)
class _Counts:
    """What is added up, sample by sample."""

    n: int = 0
    sizes: Counter[str] = field(default_factory=Counter)
    histograms: dict[str, ndarray] = field(
        default_factory=lambda: {name: np.zeros(len(edges) - 1, np.int64) for name, edges in HISTOGRAMS.items()}
    )
    coefficients: dict[str, "_Moments"] = field(default_factory=dict)
    n_with_landmarks: int = 0
    visible: ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    kinds: dict[str, Counter[str]] = field(default_factory=dict)
    numbers: dict[str, tuple[float, float, float, int]] = field(default_factory=dict)

    def add_size(self, height_px: int, width_px: int) -> None:
        """Counts the size of a picture; without layers it is unknown, 0."""
        if height_px:
            self.sizes[f"{width_px} x {height_px}"] += 1

    def add(self, sample: Triplet) -> None:
        """Counts one sample."""
        self.n += 1
        for name, value in _quantities(sample):
            place = np.searchsorted(HISTOGRAMS[name], value, side="right") - 1
            self.histograms[name][np.clip(place, 0, len(HISTOGRAMS[name]) - 2)] += 1
        for name, values in (("identity", sample.identity), ("expression", sample.expression)):
            self.coefficients.setdefault(name, _Moments.of(len(values))).add(values, sample.sample_id)
        if len(sample.visible):
            self._add_visible(sample.visible, sample.sample_id)
        for name, found in sample.attributes.items():
            self._add_attribute(name, found)

    def _add_visible(self, visible: Bool[ndarray, " m"], sample_id: str) -> None:
        if not self.n_with_landmarks:
            self.visible = np.zeros(len(visible), np.int64)
        if len(visible) != len(self.visible):
            raise _mixed(sample_id, "landmarks", len(self.visible), len(visible))
        self.n_with_landmarks += 1
        self.visible += visible

    def _add_attribute(self, name: str, value: str | float) -> None:
        if isinstance(value, str):
            counter = self.kinds.setdefault(name, Counter())
            if len(counter) <= LARGEST_KINDS:
                counter[value] += 1
        elif np.isfinite(value):
            smallest, total, largest, n = self.numbers.get(name, (np.inf, 0.0, -np.inf, 0))
            self.numbers[name] = (min(smallest, value), total + value, max(largest, value), n + 1)

    def finish(self, n_shards: int) -> DatasetStatistics:
        """The sums as shares."""
        histograms = [
            Histogram(name, UNITS[name], np.array(edges, dtype=np.float64), self.histograms[name], self.n)
            for name, edges in HISTOGRAMS.items()
            if self.histograms[name].any()
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
            coefficients=tuple(moments.finish(name, self.n) for name, moments in self.coefficients.items()),
            visible_share=self.visible / max(self.n_with_landmarks, 1),
            kinds=kinds,
            numbers=numbers,
        )


@final
@dataclass(eq=False)
class _Moments:
    """Sums over the coefficients of one basis."""

    squares: ndarray
    far: ndarray
    largest: float = 0.0

    @staticmethod
    def of(n_components: int) -> "_Moments":
        return _Moments(np.zeros(n_components), np.zeros(n_components, np.int64))

    def add(self, values: Float[ndarray, " k"], sample_id: str) -> None:
        if len(values) != len(self.squares):
            raise _mixed(sample_id, "coefficients", len(self.squares), len(values))
        self.squares += values.astype(np.float64) ** 2
        self.far += np.abs(values) > FAR_SD
        self.largest = max(self.largest, float(np.abs(values).max(initial=0)))

    def finish(self, name: str, n: int) -> CoefficientStatistics:
        return CoefficientStatistics(name, np.sqrt(self.squares / n), self.far / n, self.largest)


def _quantities(sample: Triplet) -> Iterator[tuple[str, float]]:
    """Pose and size of a face, where they are known."""
    with suppress(DegenerateGeometryError):
        pose = head_pose(sample.camera)
        yield from (("pitch", pose.pitch_deg), ("yaw", pose.yaw_deg), ("roll", pose.roll_deg))
    with suppress(DegenerateGeometryError):
        yield "face size", FaceBox.around(sample.landmarks2d).longer_side


def _mixed(sample_id: str, what: str, expected: int, found: int) -> UsageError:
    return UsageError(
        f"{sample_id}: expected {expected} {what} as in the samples before, found {found}; "
        "count the shards of one model at a time"
    )
