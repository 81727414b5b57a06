"""What ``pix2face track`` wrote for the clips of a benchmark, as predictions for their annotated frames."""

import zipfile
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from pix2face.errors import InputFileError, UsageError
from pix2face.evaluation.subjects.predictions_file import PredictedLandmarks, read_arrays

TRACK_NAME = "track.npz"
ARRAYS = ("frame", "landmarks2d", "landmarks3d", "pose_deg")


def read_tracks(folder: Path, known: Collection[str], frame_names: Mapping[str, Sequence[str]]) -> PredictedLandmarks:
    """Reads ``FOLDER/CLIP/track.npz`` of every clip.

    Args:
        folder: Holds a folder for each clip, named as the benchmark names the clip.
        known: Names of the annotated frames, ``CLIP/FRAME``; other tracked frames are left out.
        frame_names: For clips whose frames are pictures their names in order; frames of a video are numbered from 1.

    Raises:
        UsageError: There is no track of any of the clips.
        InputFileError: A track cannot be read.
    """
    names: list[str] = []
    found: dict[str, list[np.ndarray]] = {name: [] for name in ARRAYS}
    for path in sorted(folder.glob(f"*/{TRACK_NAME}")):
        clip = path.parent.name
        arrays = _arrays(path)
        of_frames = [_frame_name(clip, int(frame), frame_names.get(clip)) for frame in arrays["frame"]]
        kept = [row for row, name in enumerate(of_frames) if name in known]
        names += [of_frames[row] for row in kept]
        for name in ARRAYS:
            found[name].append(arrays[name][kept])
    if not names:
        clips = sorted({name.partition("/")[0] for name in known})
        raise UsageError(
            f"{folder}: expected CLIP/{TRACK_NAME} of clips such as {clips[0]}, found none; write them with "
            f"`pix2face track .../{clips[0]}/vid.avi --out {folder / clips[0]}`"
        )
    stacked = {name: np.concatenate(parts).astype(np.float64) for name, parts in found.items()}
    return PredictedLandmarks(
        source=folder,
        names=tuple(names),
        landmarks2d=stacked["landmarks2d"],
        landmarks3d=stacked["landmarks3d"],
        pose_deg=stacked["pose_deg"],
    )


def _arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        arrays = read_arrays(path, ARRAYS)
    except (OSError, zipfile.BadZipFile, EOFError, ValueError, NotImplementedError, RuntimeError) as error:
        raise InputFileError(f"{path}: expected what pix2face track wrote, cannot read it: {error}") from error
    n = len(arrays.get("frame", ()))
    shapes = {"frame": (n,), "landmarks2d": (n, 68, 2), "landmarks3d": (n, 68, 3), "pose_deg": (n, 3)}
    for name, shape in shapes.items():
        if name not in arrays or arrays[name].shape != shape or arrays[name].dtype.kind not in "fiu":
            raise InputFileError(f"{path}: expected {name} of shape {shape} as pix2face track writes it, found none")
    if len(np.unique(arrays["frame"])) < n:
        raise InputFileError(f"{path}: expected each frame once, found some twice")
    return arrays


def _frame_name(clip: str, frame: int, names: Sequence[str] | None) -> str:
    if names is None:
        return f"{clip}/{frame + 1:06d}"
    return f"{clip}/{names[frame]}" if 0 <= frame < len(names) else ""
