"""Writes the results of tracking frame by frame: landmarks and poses as CSV, ``.pts`` and NPZ, scenes, and an overlay.

docs/reference describes the formats. Only scenes are kept in memory, at less than a kilobyte per frame. A file gets its
name when it is complete. After an interruption, files contain the frames up to it.
"""

import csv
import zipfile
from contextlib import ExitStack, suppress
from dataclasses import astuple
from pathlib import Path
from typing import IO, Final, final, get_args

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.files.writing import GrowingFile, naming_failed_writes, write_file, written_in_one_step
from pix2face.geometry.camera import head_pose, nearest_weak_perspective
from pix2face.geometry.landmarks import N_IBUG68, ONE_BASED_TO_CENTRES_PX
from pix2face.models.morphable_model import MorphableModel
from pix2face.photographs.fit_pictures import draw_box, draw_landmarks
from pix2face.photographs.landmark_visibility import visible_landmarks
from pix2face.tracking import TrackFormat
from pix2face.tracking.export.clip_gltf import write_clip_glb
from pix2face.tracking.export.clip_scene import ClipScene
from pix2face.tracking.export.clip_usd import write_clip_usd
from pix2face.tracking.export.live_link import LiveLinkFile
from pix2face.tracking.face_follower import TrackedFace, TrackedFrame
from pix2face.tracking.face_tracks import BoxSource

BOX_SOURCES: Final[tuple[BoxSource, ...]] = get_args(BoxSource)

CSV_COLUMNS: Final = (
    *("frame", "time_s", "box", "fit", "left", "top", "right", "bottom", "score", "seen"),
    *("pitch_deg", "yaw_deg", "roll_deg", "px_per_mm"),
    *(f"{axis}{index}" for index in range(N_IBUG68) for axis in "xy"),
)

# Colours of landmarks in frames with a detection and a fit, and in all other frames.
SEEN_COLOUR, FILLED_COLOUR = (60, 255, 60), (255, 160, 40)
COPY_BYTES = 1 << 20
OVERLAY_NAME = "overlay.mp4"
FILE_NAMES = ("landmarks.csv", "track.npz", "track.glb", "track.usdc", "arkit.csv")  # of each face


@final
class TrackFiles:
    """Writes the files of one face of a clip.

    It is a context manager, which completes the files when the block ends, also if it raises.

    Args:
        folder: Existing folder to write to.
        formats: Any of "csv" (``landmarks.csv``), "npz" (``track.npz``), "pts" (``pts/000000.pts``, ...), "glb"
            (``track.glb``), "usdc" (``track.usdc``) and "arkit" (``arkit.csv``).
        fps: Frames per second.
        size_px: Height and width of the frames.
        identity: Identity coefficients of the face in standard deviations.
        model: Morphable model of the coefficients.
    """

    def __init__(
        self,
        folder: Path,
        formats: tuple[TrackFormat, ...],
        fps: float,
        size_px: tuple[int, int],
        identity: ndarray,
        model: MorphableModel,
    ) -> None:
        self._files = ExitStack()
        self._csv = self._npz = self._pts = self._scene = self._arkit = None
        if "csv" in formats:
            file = self._files.enter_context(GrowingFile(folder / "landmarks.csv"))
            self._csv = csv.writer(file, lineterminator="\n")
            self._csv.writerow(CSV_COLUMNS)
        if "npz" in formats:
            self._npz = self._files.enter_context(
                GrowingNpz(folder / "track.npz", _constant_arrays(fps, identity, model))
            )
        if "pts" in formats:
            self._pts = folder / "pts"
            self._pts.mkdir(exist_ok=True)
        if "glb" in formats or "usdc" in formats:
            self._scene = ClipScene(model, identity, size_px, fps)
            self._files.callback(_write_scene, folder, formats, self._scene)
        if "arkit" in formats:
            file = self._files.enter_context(GrowingFile(folder / "arkit.csv"))
            self._arkit = LiveLinkFile(file, model, fps)

    def __enter__(self) -> "TrackFiles":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Completes the files. A second call has no effect."""
        self._files.close()

    def write(self, face: TrackedFace, time_s: float) -> None:
        """Appends a frame."""
        if self._csv is not None:
            self._csv.writerow(_csv_row(face, time_s))
        if self._npz is not None:
            self._npz.append(_frame_arrays(face, time_s))
        if self._pts is not None and face.state != "none":
            path = self._pts / f"{face.box.frame:06d}.pts"
            write_file(path, pts_text(face.landmarks2d))
        shown = None if face.state == "none" else face.fit
        if self._scene is not None:
            self._scene.add(face.box.frame, time_s, shown)
        if self._arkit is not None:
            self._arkit.write(face.box.frame, shown)


@final
class GrowingNpz:
    """Writes an ``.npz`` row by row. Rows are stored in temporary files beside it, which are packed in the end.

    Args:
        path: The archive to write.
        constants: Arrays that do not grow.
    """

    def __init__(self, path: Path, constants: dict[str, ndarray]) -> None:
        self._path, self._constants = path, constants
        self._files: dict[str, IO[bytes]] = {}
        self._kinds: dict[str, tuple[np.dtype, tuple[int, ...]]] = {}
        self._count = 0

    def __enter__(self) -> "GrowingNpz":
        return self

    def __exit__(self, *error: object) -> None:
        self._pack()

    def append(self, row: dict[str, ndarray]) -> None:
        """Appends one row to every array."""
        with naming_failed_writes(self._path):
            for name, values in row.items():
                if name not in self._files:
                    self._files[name] = self._part(name).open("wb")
                    self._kinds[name] = (values.dtype, values.shape)
                self._files[name].write(np.ascontiguousarray(values).tobytes())
        self._count += 1

    def _part(self, name: str) -> Path:
        return self._path.with_name(f".{self._path.name}.{name}.part")

    def _pack(self) -> None:
        try:
            with (
                written_in_one_step(self._path) as unfinished,
                zipfile.ZipFile(unfinished, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
            ):
                for name, values in self._constants.items():
                    with archive.open(f"{name}.npy", "w") as member:
                        np.lib.format.write_array(member, values, allow_pickle=False)
                for name, file in self._files.items():
                    file.close()
                    self._pack_rows(archive, name)
        finally:
            for name, file in self._files.items():
                self._part(name).unlink(missing_ok=True)
                with suppress(OSError):  # a full disk was already reported
                    file.close()

    def _pack_rows(self, archive: zipfile.ZipFile, name: str) -> None:
        dtype, shape = self._kinds[name]
        header = {"descr": np.lib.format.dtype_to_descr(dtype), "fortran_order": False, "shape": (self._count, *shape)}
        left = self._count * dtype.itemsize * int(np.prod(shape))  # without a row that an interruption cut off
        with archive.open(f"{name}.npy", "w", force_zip64=True) as member, self._part(name).open("rb") as rows:
            np.lib.format.write_array_header_2_0(member, header)
            while left and (block := rows.read(min(COPY_BYTES, left))):
                member.write(block)
                left -= len(block)


def remove_earlier_files(out: Path) -> None:
    """Removes the files of an earlier run, which may be of another clip or of faces that are not found now.

    Folders that become empty are removed as well. Other files stay.
    """
    of_faces = [own for own in out.glob("face-*") if own.name.removeprefix("face-").isdecimal()]
    for folder in (out, *of_faces):
        for pattern in (*FILE_NAMES, "pts/" + "[0-9]" * 6 + ".pts", OVERLAY_NAME):
            for path in folder.glob(pattern):
                path.unlink()
    for folder in (out / "pts", *(own / "pts" for own in of_faces), *of_faces):
        with suppress(OSError):  # it is not empty, or not there
            folder.rmdir()


def draw_frame(frame: TrackedFrame) -> UInt8[ndarray, "_ _ 3"]:
    """Draws landmarks, boxes and scores on a frame: green if detected and fitted, otherwise orange."""
    picture = frame.image
    for face in frame.faces.values():
        if face.state == "none":
            continue
        is_seen = face.is_fitted and face.box.source == "detected"
        colour = SEEN_COLOUR if is_seen else FILLED_COLOUR
        picture = draw_landmarks(picture, face.landmarks2d, colour)
        draw_box(picture, face.box.box, face.box.score, colour)
    return picture


def _write_scene(folder: Path, formats: tuple[TrackFormat, ...], scene: ClipScene) -> None:
    if not scene.shows_face:
        return
    if "glb" in formats:
        write_clip_glb(folder / "track.glb", scene)
    if "usdc" in formats:
        write_clip_usd(folder / "track.usdc", scene)


def _csv_row(face: TrackedFace, time_s: float) -> list[object]:
    sides = (f"{side:.2f}" for side in face.box.box.sides)
    row: list[object] = [face.box.frame, f"{time_s:.4f}", face.box.source, face.state, *sides]
    row += [_number(face.box.score), _number(face.seen_share)]
    if face.state == "none":
        return row + [""] * (len(CSV_COLUMNS) - len(row))
    angles = (f"{angle:.3f}" for angle in astuple(head_pose(face.fit.camera)))
    scale = nearest_weak_perspective(face.fit.camera).scale
    return [*row, *angles, f"{scale:.6g}", *(f"{value:.3f}" for value in face.landmarks2d.reshape(-1))]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def pts_text(landmarks2d: ndarray) -> str:
    """Formats landmarks as a .pts file of 300-W, where pixel centres are integers that start at 1."""
    rows = "\n".join(f"{x:.3f} {y:.3f}" for x, y in landmarks2d - ONE_BASED_TO_CENTRES_PX)
    return f"version: 1\nn_points: {len(landmarks2d)}\n{{\n{rows}\n}}\n"


def _constant_arrays(fps: float, identity: ndarray, model: MorphableModel) -> dict[str, ndarray]:
    return {
        "identity": identity,
        "fps": np.array(fps),
        "model_name": np.array(model.name),
        "model_sha256": np.array(model.sha256),
        "box_sources": np.array(BOX_SOURCES),
    }


def _frame_arrays(face: TrackedFace, time_s: float) -> dict[str, ndarray]:
    of_fit = _fit_arrays(face)
    if face.state == "none":
        of_fit = {name: np.full_like(values, np.nan) for name, values in of_fit.items()}
    return {
        "frame": np.array(face.box.frame, dtype=np.int64),
        "time_s": np.array(time_s),
        "box": np.array(face.box.box.sides, dtype=np.float32),
        "score": np.array(np.nan if face.box.score is None else face.box.score, dtype=np.float32),
        "seen_share": np.array(np.nan if face.seen_share is None else face.seen_share, dtype=np.float32),
        "box_source": np.array(BOX_SOURCES.index(face.box.source), dtype=np.uint8),
        "is_fitted": np.array(face.is_fitted),
        "landmarks_visible": visible_landmarks(face.fit) & (face.state != "none"),
        **of_fit,
    }


def _fit_arrays(face: TrackedFace) -> dict[str, ndarray]:
    errors_px = face.fit.landmark_errors_px
    if errors_px is None:
        errors_px = np.full(len(face.landmarks2d), np.nan)
    return {
        "landmarks2d": face.landmarks2d.astype(np.float32),
        "landmarks2d_raw": face.fit.landmarks2d.astype(np.float32),
        "landmarks3d": face.fit.landmarks3d.astype(np.float32),
        "landmark_errors_px": errors_px.astype(np.float32),
        "eye_px": np.array(face.eye_px, dtype=np.float32),
        "camera": face.fit.camera.matrix,
        "expression": face.fit.expression.astype(np.float32),
        "pose_deg": np.array(astuple(head_pose(face.fit.camera)), dtype=np.float32),
    }
