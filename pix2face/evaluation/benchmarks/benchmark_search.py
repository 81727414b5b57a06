"""Looks for a benchmark's files, whatever kind they are of."""

from pathlib import Path

from pix2face.errors import UsageError
from pix2face.evaluation.benchmarks.benchmark_clips import find_clips
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFiles
from pix2face.evaluation.benchmarks.benchmark_photographs import find_photographs
from pix2face.evaluation.benchmarks.benchmark_shards import find_shards
from pix2face.evaluation.benchmarks.manifest import Manifest
from pix2face.models.morphable_model import MorphableModel


def find_benchmark(
    manifest: Manifest, data: Path | None, model: MorphableModel, reannotated: Path | None = None
) -> BenchmarkFiles:
    """Looks for the files of a split below a folder.

    Args:
        manifest: The split.
        data: Where its files are; None where nobody said.
        model: The model in use: maps of another one cannot be compared.
        reannotated: File of re-annotated landmarks, where those are wanted; None looks for it beside the pictures.

    Raises:
        UsageError: There is nothing of the split, or shards of other faces; says where it is to be had.
        ModelMismatchError: Shards of another model.
    """
    if data is None:
        raise UsageError(
            f"{manifest.split} ({manifest.title}) needs its data: pass --data DATA or set PIX2FACE_DATA. "
            f"{manifest.how_to_get_it}"
        )
    if reannotated is not None and manifest.truth != "reannotated":
        raise UsageError(f"--reannotated {reannotated}: expected --truth reannotated with it, found {manifest.truth}")
    if manifest.kind == "shards":
        found = find_shards(manifest, data, model)
    elif manifest.kind == "clips":
        found = find_clips(manifest, data)
    else:
        found = find_photographs(manifest, data, reannotated)
    if not found.items and not found.unreadable:
        what = "none of its faces complete" if data.is_dir() else "no such folder"
        raise UsageError(
            f"{data}: expected the data of {manifest.split} ({manifest.title}), found {what}. {manifest.how_to_get_it}"
        )
    return found
