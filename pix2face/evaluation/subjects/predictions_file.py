"""Landmarks of any system, in a file: ``.npz`` or ``.csv`` (layout: docs/reference/evaluation.md).

A system that found no face writes NaN, or leaves the face out; both count as failures when it is measured.
"""

import csv
import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.errors import InputFileError, UsageError
from pix2face.evaluation.evaluate_config import PixelFrame
from pix2face.files.npz_files import read_npz
from pix2face.files.opening import text_lines
from pix2face.files.writing import write_file
from pix2face.geometry.landmarks import N_IBUG68

TO_PROJECT_PX: Mapping[PixelFrame, float] = {"0-based": 0.5, "1-based": -0.5, "half-pixel": 0.0}
LARGEST_COORDINATE = 1e9
# Half a million faces, with points in space.
LARGEST_NPZ_BYTES = LARGEST_CSV_BYTES = 1 << 30
NPZ_ARRAYS = ("names", "landmarks", "landmarks3d", "pose_deg")
TRACK_NAME, TRACK_ARRAYS = "track.npz", ("frame", "landmarks2d", "landmarks3d", "pose_deg")


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Predictions:
    """The predictions of a system for some faces."""

    source: Path  # the file
    names: tuple[str, ...]  # names of the faces, all different
    landmarks2d: Float64[ndarray, "n 68 2"]  # pixels of the picture, centres at +0.5; NaN where no face was found
    landmarks3d: Float64[ndarray, "n 68 3"] | None = None  # in the system's own unit and axes
    z_px: Float64[ndarray, "n 68"] | None = None  # in the picture, towards the viewer, up to a constant
    pose_deg: Float64[ndarray, "n 3"] | None = None  # pitch, yaw, roll with the signs of 300W-LP


def read_predictions(path: Path, frame: PixelFrame = "0-based") -> Predictions:
    """Reads a file of landmarks.

    Args:
        path: ``.npz`` with ``names`` (N) and ``landmarks`` (N, 68, 2 or 3), and optionally ``landmarks3d`` (N, 68, 3)
            and ``pose_deg`` (N, 3); or ``.csv`` with a heading ``name,x0,y0,...,x67,y67`` (or with ``z0`` to ``z67``).
        frame: Where the file has its pixel centres.

    Raises:
        InputFileError: It cannot be read, lacks an array, has wrong shapes, or a name twice.
    """
    if path.suffix.lower() not in (".npz", ".csv"):
        raise InputFileError(f"{path}: expected predictions as .npz or .csv, found {path.suffix or 'no ending'!r}")
    arrays = _read_npz(path) if path.suffix.lower() == ".npz" else _read_csv(path)
    n = arrays["names"].size
    landmarks = _numbers(path, "landmarks", arrays["landmarks"], (n, N_IBUG68), (2, 3))
    names = _names(path, arrays["names"])
    points3d = _optional(path, arrays, "landmarks3d", (n, N_IBUG68))
    if points3d is None and landmarks.shape[2] == 3:
        points3d = landmarks
    return Predictions(
        source=path,
        names=names,
        landmarks2d=landmarks[..., :2] + TO_PROJECT_PX[frame],
        landmarks3d=points3d,
        z_px=landmarks[..., 2] if landmarks.shape[2] == 3 else None,
        pose_deg=_optional(path, arrays, "pose_deg", (n,)),
    )


def write_predictions(path: Path, predicted: Predictions) -> None:
    """Writes the ``.npz`` that ``read_predictions`` reads, 0-based with integer centres."""
    names, landmarks = np.asarray(predicted.names, dtype=np.str_), predicted.landmarks2d - TO_PROJECT_PX["0-based"]
    if predicted.z_px is not None:
        landmarks = np.concatenate([landmarks, predicted.z_px[..., None]], axis=2)
    optional: dict[str, Any] = {"landmarks3d": predicted.landmarks3d, "pose_deg": predicted.pose_deg}
    known = {name: values for name, values in optional.items() if values is not None}
    content = BytesIO()
    np.savez_compressed(content, names=names, landmarks=landmarks, **known)
    write_file(path, content.getvalue())


def _read_npz(path: Path) -> dict[str, ndarray]:
    arrays = read_npz(path, NPZ_ARRAYS, "an .npz file of predictions", LARGEST_NPZ_BYTES)
    lacking = [name for name in ("names", "landmarks") if name not in arrays]
    if lacking:
        raise InputFileError(f"{path}: expected the arrays names and landmarks, missing {' and '.join(lacking)}")
    return arrays


def _read_csv(path: Path) -> dict[str, ndarray]:
    rows = _csv_rows(path)
    heading = [word.strip() for word in next(rows, [])]
    axes = next((axes for axes in ("xy", "xyz") if heading == _csv_heading(axes)), None)
    if axes is None:
        raise InputFileError(
            f"{path}: expected the heading name,x0,y0,...,x{N_IBUG68 - 1},y{N_IBUG68 - 1} (or name,x0,y0,z0,...), "
            f"found {','.join(heading[:4])[:80] or 'nothing'}... of {len(heading)} columns"
        )
    names, numbers = list[str](), list[ndarray]()
    for number, row in enumerate(rows, 2):
        if len(row) != len(heading):
            raise InputFileError(f"{path}: expected {len(heading)} columns in row {number}, found {len(row)}")
        names.append(row[0])
        try:
            numbers.append(np.array([float(word) if word.strip() else math.nan for word in row[1:]]))
        except ValueError as error:
            raise InputFileError(f"{path}: expected numbers in row {number}, found: {error}") from error
    return {
        "names": np.array(names, dtype=object),
        "landmarks": np.array(numbers).reshape(len(names), N_IBUG68, len(axes)),
    }


def _csv_rows(path: Path) -> Iterator[list[str]]:
    expected = "a .csv file of predictions"
    try:
        yield from (row for row in csv.reader(text_lines(path, expected, LARGEST_CSV_BYTES)) if row)
    except csv.Error as error:
        raise InputFileError(f"{path}: expected {expected}, found: {error}") from error


def _csv_heading(axes: str) -> list[str]:
    return ["name", *(f"{axis}{index}" for index in range(N_IBUG68) for axis in axes)]


def _names(path: Path, names: ndarray) -> tuple[str, ...]:
    if names.ndim != 1 or names.dtype.kind not in "USO" or not len(names):
        raise InputFileError(
            f"{path}: expected names as a list of texts, found an array of shape {names.shape} and type {names.dtype}"
        )
    texts = [name.decode("utf-8", "replace") if isinstance(name, bytes) else str(name) for name in names.tolist()]
    most_common, count = Counter(texts).most_common(1)[0]
    if count > 1:
        raise InputFileError(f"{path}: expected each name once, found {most_common!r} {count} times")
    return tuple(texts)


def _optional(
    path: Path, arrays: Mapping[str, ndarray], name: str, shape: tuple[int, ...]
) -> Float64[ndarray, "*n 3"] | None:
    return _numbers(path, name, arrays[name], shape, (3,)) if name in arrays else None


def _numbers(
    path: Path, name: str, values: ndarray, shape: tuple[int, ...], last: tuple[int, ...]
) -> Float64[ndarray, "*n c"]:
    wanted = [(*shape, size) for size in last]
    if values.shape not in wanted or values.dtype.kind not in "fiu":
        raise InputFileError(
            f"{path}: expected {name} as numbers of shape {' or '.join(map(str, wanted))}, "
            f"found shape {values.shape} and type {values.dtype}"
        )
    numbers = values.astype(np.float64)
    is_finite = np.isfinite(numbers)
    largest = max(numbers.max(initial=0, where=is_finite), -numbers.min(initial=0, where=is_finite))
    if largest > LARGEST_COORDINATE:
        raise InputFileError(
            f"{path}: expected {name} up to ±{LARGEST_COORDINATE:g}, found {largest:g}; say NaN where no face was found"
        )
    return numbers


def read_tracks(folder: Path, known: Collection[str], frame_names: Mapping[str, Sequence[str]]) -> Predictions:
    """Reads ``FOLDER/CLIP/track.npz`` of every clip, with the frames whose names (``CLIP/FRAME``) are ``known``.

    ``frame_names`` are those of ``BenchmarkFiles``.

    Raises:
        UsageError: There is no track of any of the clips.
        InputFileError: A track cannot be read.
    """
    names: list[str] = []
    found: dict[str, list[np.ndarray]] = {name: [] for name in TRACK_ARRAYS if name != "frame"}
    for path in sorted(folder.glob(f"*/{TRACK_NAME}")):
        clip = path.parent.name
        arrays = _arrays(path)
        of_frames = [_frame_name(clip, int(frame), frame_names.get(clip)) for frame in arrays["frame"]]
        is_found = np.isfinite(arrays["landmarks2d"]).all(axis=(1, 2))  # NaN where there was no face
        kept = [row for row, name in enumerate(of_frames) if name in known and is_found[row]]
        names += [of_frames[row] for row in kept]
        for name, parts in found.items():
            parts.append(arrays[name][kept])
    if not names:
        clips = sorted({name.partition("/")[0] for name in known})
        raise UsageError(
            f"{folder}: expected CLIP/{TRACK_NAME} of clips such as {clips[0]}, found none; write them with "
            f"`pix2face track .../{clips[0]}/vid.avi --out {folder / clips[0]}`"
        )
    stacked = {name: np.concatenate(parts).astype(np.float64) for name, parts in found.items()}
    return Predictions(source=folder, names=tuple(names), **stacked)


def _arrays(path: Path) -> dict[str, np.ndarray]:
    arrays = read_npz(path, TRACK_ARRAYS, "what pix2face track wrote", LARGEST_NPZ_BYTES)
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
