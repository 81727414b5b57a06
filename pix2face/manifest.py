"""Manifests: what a benchmark consists of, how it is measured, on which terms, and where it is to be had.

One TOML file a split and lists of file names lie in the folder ``manifests``; none of the pictures does.
"""

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any, Literal, final

from pix2face.errors import UsageError
from pix2face.metrics import Normaliser

SPLITS = ("ibug", "300w-common", "300w-full", "aflw2000-3d", "builtin-heldout")
SCHEMA_VERSION = 1

# How pictures and truth are stored: an image beside its .pts, an image beside its .mat, or shards of triplets.
Kind = Literal["pts", "w300lp-mat", "shards"]
# What the columns of the table are: the benchmark's parts, or bins of |yaw|.
Grouping = Literal["parts", "yaw"]


@final
@dataclass(frozen=True)
class BenchmarkPart:
    """A list of pictures that lie in one folder.

    Attributes:
        name: What tables call it.
        image_names: File names of the pictures, in the benchmark's order.
        folders: Where they may lie below a home, the first that holds any of them counts.
    """

    name: str
    image_names: tuple[str, ...]
    folders: tuple[str, ...]


@final
@dataclass(frozen=True, kw_only=True)
class Manifest:
    """A benchmark split.

    Attributes:
        split: Its name on the command line.
        title: Its name for people.
        kind: How pictures and truth are stored.
        ground_truth: Which truth is meant, in words.
        landmark_scheme: Scheme of the landmarks.
        normaliser: What errors are divided by.
        threshold: Where a face counts as failed, and where the error curve ends; a fraction.
        box_rule: Which box the crop is made from, in words.
        groups: What the columns of the table are.
        licence: Terms of the data.
        obtain: Where the data is to be had, in words.
        layout: How it is to be laid out, in words.
        homes: Folders below the data folder to look in.
        parts: The pictures; empty for shards.
        n_samples: How many faces are expected.
        seed: Of the draw whose faces a split of shards consists of; None for photographs.
    """

    split: str
    title: str
    kind: Kind
    ground_truth: str
    landmark_scheme: str
    normaliser: Normaliser
    threshold: float
    box_rule: str
    groups: Grouping
    licence: str
    obtain: str
    layout: str
    homes: tuple[str, ...]
    parts: tuple[BenchmarkPart, ...]
    n_samples: int
    seed: int | None = None

    @property
    def sample_ids(self) -> tuple[str, ...]:
        """The ids of the samples in the shards, as ``datagen sample`` gives them; empty for photographs."""
        return () if self.seed is None else tuple(f"seed{self.seed}/{index:07d}" for index in range(self.n_samples))

    @property
    def how_to_get_it(self) -> str:
        """Where the data is to be had and how it is to be laid out: the end of messages about missing data."""
        return f"To get it: {self.obtain}. Lay it out as {self.layout}. Terms: {self.licence}."


def load_manifest(split: str) -> Manifest:
    """Reads the manifest of a split.

    Raises:
        UsageError: There is no such split.
    """
    if split not in SPLITS:
        raise UsageError(f"expected a split out of {', '.join(SPLITS)}, found {split!r}")
    folder = files("pix2face") / "manifests"
    fields: dict[str, Any] = tomllib.loads((folder / f"{split}.toml").read_text(encoding="utf-8"))
    if fields.pop("schema_version") != SCHEMA_VERSION:
        raise UsageError(f"manifest of {split}: expected schema {SCHEMA_VERSION}; is the installation complete?")
    parts = tuple(_read_part(folder, part) for part in fields.pop("part", []))
    n_samples = fields.pop("n_samples", sum(len(part.image_names) for part in parts))
    return Manifest(parts=parts, n_samples=n_samples, homes=tuple(fields.pop("homes")), **fields)


def _read_part(folder: Traversable, part: dict[str, Any]) -> BenchmarkPart:
    names = (folder / part["names"]).read_text(encoding="utf-8").split("\n")
    return BenchmarkPart(part["name"], tuple(name for name in names if name), tuple(part["folders"]))
