"""Manifests: which files a benchmark consists of, how it is measured, its terms, and where to get it.

The folder ``manifests`` has one TOML file for each split, and lists of file names, but no pictures.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Literal, final, get_args

from pix2face.errors import UsageError
from pix2face.geometry import Alignment, Normaliser

Split = Literal[
    "ibug",
    "300w-common",
    "300w-full",
    "300vw",
    "aflw2000-3d",
    "aflw2000-3d-dev",
    "aflw2000-3d-rest",
    "menpo3d-tracking",
    "builtin-heldout",
    "builtin-photographs",
]
SPLITS = get_args(Split)
SCHEMA_VERSION = 1

# How pictures and truth are stored: an image beside its .pts, an image beside its .mat, clips with a .pts for each
# frame, or shards of triplets.
Kind = Literal["pts", "w300lp-mat", "clips", "shards"]
# What the columns of the table are: the benchmark's parts, or bins of |yaw|.
Grouping = Literal["parts", "yaw"]


@final
@dataclass(frozen=True)
class BenchmarkPart:
    """A list of pictures that lie in one folder, or of clips."""

    name: str  # its name in tables
    image_names: tuple[str, ...] = ()  # file names of the pictures, in the benchmark's order
    folders: tuple[str, ...] = ()  # where they may lie below a home; the first folder that holds any of them counts
    clips: tuple[str, ...] = ()  # names of clips, each a folder
    all_others: bool = False  # whether all clips that no other part names belong to this one


@final
@dataclass(frozen=True, kw_only=True)
class Manifest:
    """A benchmark split."""

    split: str  # its name on the command line
    title: str  # its name for people
    kind: Kind
    truth: str  # the ground truth in a word
    ground_truth: str  # the ground truth in full
    landmark_scheme: str  # of the truth, for the report
    normaliser: Normaliser  # what errors are divided by
    threshold: float  # above it a face counts as failed, and there the error curve ends; a fraction
    box_rule: str  # the box that the crop is made from, in words
    groups: Grouping
    licence: str  # terms of the data
    obtain: str  # where the data can be obtained, in words
    layout: str  # how to lay it out, in words
    homes: tuple[str, ...]  # folders below the data folder to look in
    parts: tuple[BenchmarkPart, ...]  # the pictures; empty for shards
    n_samples: int  # how many pictures (of clips: how many clips) the benchmark has
    seed: int | None = None  # the seed that the faces of a split of shards were drawn with; None for photographs
    other_truths: Mapping[str, str] = field(default_factory=dict)  # other possible truths: word, and in full
    reannotated_files: tuple[str, ...] = ()  # possible names of a file of re-annotated landmarks
    landmark_type: Literal["3d", "2d"] = "3d"  # what was marked; see ``FitOptions``
    pictures_in: tuple[str, ...] = ()  # folders of a clip that may hold its frames
    n_annotated: int | None = None  # a number of points that annotations may have instead of 68
    landmark_indices: tuple[int, ...] = ()  # which of these points the 68 are
    alignment: Alignment | None = None  # how 3D landmarks are aligned with the true ones; None without 3D truth
    threshold3d: float | None = None  # where the curve of 3D distances ends, in the unit of the data
    by: tuple[str, ...] = ()  # for shards: expressions (`pix2face.shards.sample_filter`) by which errors are split

    def with_truth(self, truth: str) -> "Manifest":
        """The benchmark measured against another truth.

        Raises:
            UsageError: It has no such truth.
        """
        if truth == self.truth:
            return self
        if truth not in self.other_truths:
            known = " or ".join((self.truth, *self.other_truths))
            raise UsageError(f"{self.split}: expected {known} as --truth, found {truth}")
        return replace(self, truth=truth, ground_truth=self.other_truths[truth])

    @property
    def what_is_counted(self) -> str:
        """A word for the pictures of the benchmark."""
        return "frame" if self.kind == "clips" else "image"

    @property
    def sample_ids(self) -> tuple[str, ...]:
        """The ids of the samples in the shards, as ``datagen sample`` gives them; empty for photographs."""
        return () if self.seed is None else tuple(f"seed{self.seed}/{index:07d}" for index in range(self.n_samples))

    @property
    def how_to_get_it(self) -> str:
        """Where to get the data and how to lay it out, for the end of messages about missing data."""
        return f"To get it: {self.obtain}. Lay it out as {self.layout}. Terms: {self.licence}."


def load_manifest(split: str) -> Manifest:
    """Reads the manifest of a split.

    Raises:
        UsageError: There is no such split.
    """
    if split not in SPLITS:
        raise UsageError(f"expected a split out of {', '.join(SPLITS)}, found {split!r}")
    folder = _manifest_folder()
    fields = _read_fields(folder, split)
    if fields.pop("schema_version") != SCHEMA_VERSION:
        raise UsageError(f"manifest of {split}: expected schema {SCHEMA_VERSION}; is the installation complete?")
    parts = tuple(_read_part(folder, part) for part in fields.pop("part", []))
    fields.setdefault("n_samples", sum(len(part.image_names) for part in parts))
    listed: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in fields.items()
    }
    return Manifest(parts=parts, **listed)


def _manifest_folder() -> Traversable:
    """A wheel holds the manifests inside the package; a checkout and an editable install have them at the top level."""
    installed = files("pix2face") / "manifests"
    return installed if installed.is_dir() else Path(__file__).parents[3] / "manifests"


def _read_fields(folder: Traversable, split: str) -> dict[str, Any]:
    """The fields of the split's file, and those that it inherits from the split that it is ``like``."""
    fields: dict[str, Any] = tomllib.loads((folder / f"{split}.toml").read_text(encoding="utf-8"))
    return {**_read_fields(folder, fields.pop("like")), **fields} if "like" in fields else fields


def _read_part(folder: Traversable, part: dict[str, Any]) -> BenchmarkPart:
    if "names" not in part:
        clips = tuple(f"{clip:03d}" for clip in part.get("clips", ()))
        return BenchmarkPart(part["name"], clips=clips, all_others=part.get("all_others", False))
    names = (folder / part["names"]).read_text(encoding="utf-8").split("\n")
    return BenchmarkPart(part["name"], tuple(name for name in names if name), tuple(part["folders"]))
