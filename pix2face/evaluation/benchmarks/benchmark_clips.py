"""Benchmarks of clips: a folder for each, with a ``.pts`` for each frame and the frames as pictures or a video."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import final

import cv2
import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.evaluation.benchmarks.benchmark_data import (
    BenchmarkFace,
    BenchmarkFiles,
    BenchmarkItem,
    complete,
    picture_reader,
)
from pix2face.evaluation.benchmarks.manifest import Manifest
from pix2face.files.images import open_capture
from pix2face.files.opening import open_regular, read_regular
from pix2face.geometry.landmarks import LARGEST_PTS_BYTES, N_IBUG68, read_pts

ANNOTATIONS, ANNOTATIONS_3D = "annot", "annot3d"
PICTURE_SUFFIXES = (".jpg", ".png", ".jpeg")
VIDEO_NAMES = ("vid.avi", "vid.mp4")


def find_clips(manifest: Manifest, data: Path) -> BenchmarkFiles:
    """The annotated frames of a split below a folder, and the named clips that are missing."""
    clips = next(filter(None, (_clips_in(data / home) for home in manifest.homes)), [])
    part_of = {clip: part.name for part in manifest.parts for clip in part.clips}
    rest = next((part.name for part in manifest.parts if part.all_others), None)
    items: list[BenchmarkItem] = []
    absent: list[str] = []
    frame_names: dict[str, tuple[str, ...]] = {}
    videos = _VideoReader()
    names = {clip.name for clip in clips}
    missing = [clip for clip in part_of if clip not in names]
    for clip in clips:
        group = part_of.get(clip.name, rest)
        if group is None:
            continue
        pictures = _Pictures(clip, manifest.pictures_in, videos)
        if pictures.stems:
            frame_names[clip.name] = pictures.stems
        for annotation in sorted((clip / ANNOTATIONS).glob("*.pts")):
            name = f"{clip.name}/{annotation.stem}"
            read_image = pictures.reader(annotation.stem)
            if read_image is None:
                missing.append(f"{name} (no picture, no {VIDEO_NAMES[0]})")
                absent.append(name)
            else:
                items.append(BenchmarkItem(name, partial(_read_frame, manifest, name, group, annotation, read_image)))
    return BenchmarkFiles(tuple(items), tuple(missing), absent_names=tuple(absent), frame_names=frame_names)


def _clips_in(home: Path) -> list[Path]:
    if not home.is_dir():
        return []
    return sorted(folder for folder in home.iterdir() if any((folder / ANNOTATIONS).glob("*.pts")))


def _read_frame(
    manifest: Manifest, name: str, group: str, annotation: Path, read_image: Callable[[], UInt8[ndarray, "h w 3"]]
) -> BenchmarkFace:
    points3d = annotation.parent.parent / ANNOTATIONS_3D / annotation.name
    return BenchmarkFace(
        name=name,
        group=group,
        landmarks2d=complete(_read_points(manifest, annotation), annotation),
        read_image=read_image,
        clip=name.partition("/")[0],
        landmarks3d=_read_points3d(manifest, points3d) if points3d.is_file() else None,
    )


def _read_points(manifest: Manifest, path: Path) -> Float64[ndarray, "68 2"]:
    """The 68 points of an annotation, which has these or all points of the benchmark's own scheme."""
    if manifest.n_annotated is not None and _declared_points(path) == manifest.n_annotated:
        return read_pts(path, manifest.n_annotated)[list(manifest.landmark_indices)]
    return read_pts(path)


def _declared_points(path: Path) -> int | None:
    try:
        with open_regular(path, "an annotation", LARGEST_PTS_BYTES) as file:
            words = file.read(200).partition(b"n_points:")[2].split()
    except InputFileError:
        return None  # read_pts then says why it cannot be read
    return int(words[0]) if words and words[0].isdigit() else None


def _read_points3d(manifest: Manifest, path: Path) -> Float64[ndarray, "68 3"]:
    """3D points in the unit of the data: three numbers a line, between braces."""
    try:
        body = read_regular(path, "points in space", LARGEST_PTS_BYTES).partition(b"{")[2].partition(b"}")[0]
        numbers = np.array(body.split(), dtype=np.float64)
    except ValueError as error:
        raise InputFileError(f"{path}: expected three numbers a line: {error}") from error
    counts = [N_IBUG68] if manifest.n_annotated is None else [manifest.n_annotated, N_IBUG68]
    if len(numbers) not in [3 * count for count in counts]:
        wanted = " or ".join(str(count) for count in counts)
        raise InputFileError(f"{path}: expected {wanted} points of three numbers, found {len(numbers)} numbers")
    if not np.isfinite(numbers).all():
        raise InputFileError(f"{path}: expected finite coordinates, found NaN or infinity")
    points = numbers.reshape(-1, 3)
    return points if len(points) == N_IBUG68 else points[list(manifest.landmark_indices)]


@final
class _Pictures:
    """The frames of a clip, from its folders of pictures or else from its video."""

    def __init__(self, clip: Path, folders: tuple[str, ...], videos: "_VideoReader") -> None:
        self._by_stem = {
            path.stem: path
            for folder in reversed(folders)
            if (clip / folder).is_dir()
            for path in (clip / folder).iterdir()
            if path.suffix.lower() in PICTURE_SUFFIXES
        }
        self._video = next((clip / name for name in VIDEO_NAMES if (clip / name).is_file()), None)
        self._videos = videos

    @property
    def stems(self) -> tuple[str, ...]:
        """The names of the pictures, in order; empty for a video."""
        return tuple(sorted(self._by_stem))

    def reader(self, stem: str) -> Callable[[], UInt8[ndarray, "h w 3"]] | None:
        """A function that reads the frame of an annotation; None where there is no such frame."""
        if stem in self._by_stem:
            return picture_reader(self._by_stem[stem])
        if self._video is not None and stem.isdigit():
            return partial(self._videos.frame, self._video, int(stem) - 1)  # annotations count from 1
        return None


@final
class _VideoReader:
    """Frames of videos by number. Only one video is open at a time.

    Codecs do not seek exactly, so frames are counted from the last one read, or from the start.
    """

    def __init__(self) -> None:
        self._path: Path | None = None
        self._capture = cv2.VideoCapture()
        self._next = 0

    def frame(self, path: Path, number: int) -> UInt8[ndarray, "h w 3"]:
        """A frame, RGB, counted from 0.

        Raises:
            InputFileError: The video cannot be read, or ends before this frame.
        """
        if path != self._path or number < self._next:
            self._capture.release()
            self._capture = open_capture(path)
            self._path, self._next = path, 0
        while self._next < number and self._capture.grab():
            self._next += 1
        is_read, image = self._capture.read() if self._next == number else (False, None)
        if not is_read or image is None:
            self._path = None
            raise InputFileError(f"{path}: expected a frame {number + 1}, found {self._next} that can be read")
        self._next += 1
        return np.ascontiguousarray(image[..., ::-1])
