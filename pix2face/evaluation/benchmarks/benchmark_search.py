"""Finds the files of a benchmark of any kind."""

from collections.abc import Sequence
from pathlib import Path, PurePosixPath

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
    """Finds the files of a split below a folder; shards must be of the model.

    ``reannotated`` is the file of re-annotated landmarks, if they are the truth; None looks for it beside the pictures.

    Raises:
        UsageError: The folder has nothing of the split, or shards of other faces. The message says where to get it.
        ModelMismatchError: The shards are of another model.
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


N_NAMES_SHOWN = 3


def match_names(given: Sequence[str], known: Sequence[str], whose: str) -> dict[str, int]:
    """The place of each known full name among the given names, which are all different.

    A name may be given in full ("ibug/image_003_1.jpg"), without its folder, without its ending, or without both.
    Messages call the benchmark ``whose``.

    Raises:
        UsageError: A name belongs to no face, to several, or two belong to the same.
    """
    full_names = _by_alias(known)
    unknown = [name for name in given if name not in full_names]
    if unknown:
        shown = ", ".join(repr(name) for name in unknown[:N_NAMES_SHOWN])
        raise UsageError(
            f"expected names of {whose} such as {known[0]!r} or {PurePosixPath(known[0]).stem!r}, found {shown}"
            + (f" and {len(unknown) - N_NAMES_SHOWN} more" if len(unknown) > N_NAMES_SHOWN else "")
        )
    places: dict[str, int] = {}
    for place, name in enumerate(given):
        meant = full_names[name]
        if len(meant) > 1:
            raise UsageError(
                f"expected names that tell the faces of {whose} apart, found {name!r}, which may be {meant[0]!r} or "
                f"{meant[1]!r}; give it in full"
            )
        if meant[0] in places:
            raise UsageError(
                f"expected each face of {whose} once, found {meant[0]!r} as {given[places[meant[0]]]!r} and as {name!r}"
            )
        places[meant[0]] = place
    return places


def _by_alias(known: Sequence[str]) -> dict[str, list[str]]:
    full_names: dict[str, list[str]] = {name: [name] for name in known}
    for name in known:
        path = PurePosixPath(name)
        for alias in {path.name, path.stem, str(path.with_suffix(""))} - set(known):
            full_names.setdefault(alias, []).append(name)
    return full_names
