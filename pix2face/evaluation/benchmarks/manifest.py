"""Manifests: what a benchmark consists of, how it is measured, on which terms, and where it is to be had.

One TOML file a split and lists of file names lie in the folder ``manifests``; none of the pictures does.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Literal, final, get_args

from pix2face.errors import UsageError
from pix2face.geometry.landmark_metrics import Alignment, Normaliser

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
    """A list of pictures that lie in one folder, or of clips.

    Attributes:
        name: What tables call it.
        image_names: File names of the pictures, in the benchmark's order.
        folders: Where they may lie below a home, the first that holds any of them counts.
        clips: Names of clips, each a folder.
        all_others: Whether every clip that no other part names belongs here.
    """

    name: str
    image_names: tuple[str, ...] = ()
    folders: tuple[str, ...] = ()
    clips: tuple[str, ...] = ()
    all_others: bool = False


@final
@dataclass(frozen=True, kw_only=True)
class Manifest:
    """A benchmark split.

    Attributes:
        split: Its name on the command line.
        title: Its name for people.
        kind: How pictures and truth are stored.
        truth: Which truth is meant, in a word.
        ground_truth: The same in full.
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
        n_samples: How many pictures (of clips: how many clips) the benchmark has.
        seed: Of the draw whose faces a split of shards consists of; None for photographs.
        other_truths: What else can be taken for the truth: a word, and the same in full.
        reannotated_files: What a file of re-annotated landmarks may be called.
        jaw_follows_outline: Whether jaw points were marked where the face ends in the picture.
        pictures_in: Folders of a clip that its frames may lie in.
        n_annotated: How many points annotations may have instead of 68; None for no other number.
        landmark_indices: Which of those the 68 are.
        alignment: How 3D landmarks are laid onto the true ones before they are compared; None where there are none.
        threshold3d: Where the curve of 3D distances ends, in the data's unit.
        by: Expressions of attributes (``pix2face.shards.sample_filter``) that errors are also told apart by; of shards.
    """

    split: str
    title: str
    kind: Kind
    truth: str
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
    other_truths: Mapping[str, str] = field(default_factory=dict)
    reannotated_files: tuple[str, ...] = ()
    jaw_follows_outline: bool = False
    pictures_in: tuple[str, ...] = ()
    n_annotated: int | None = None
    landmark_indices: tuple[int, ...] = ()
    alignment: Alignment | None = None
    threshold3d: float | None = None
    by: tuple[str, ...] = ()

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
        """A word for what the truth is annotated on."""
        return "frame" if self.kind == "clips" else "image"

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
    """Those of its file, over those of the split that it is ``like``."""
    fields: dict[str, Any] = tomllib.loads((folder / f"{split}.toml").read_text(encoding="utf-8"))
    return {**_read_fields(folder, fields.pop("like")), **fields} if "like" in fields else fields


def _read_part(folder: Traversable, part: dict[str, Any]) -> BenchmarkPart:
    if "names" not in part:
        clips = tuple(f"{clip:03d}" for clip in part.get("clips", ()))
        return BenchmarkPart(part["name"], clips=clips, all_others=part.get("all_others", False))
    names = (folder / part["names"]).read_text(encoding="utf-8").split("\n")
    return BenchmarkPart(part["name"], tuple(name for name in names if name), tuple(part["folders"]))
