"""Reads frames from videos, folders of pictures and numbered patterns, and writes videos, one frame at a time."""

import re
import stat
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import final

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.errors import InputFileError, UsageError
from pix2face.files.images import IMAGE_SUFFIXES, open_capture, read_photograph
from pix2face.files.opening import check_regular
from pix2face.tracking.ahead import ahead

Frame = UInt8[ndarray, "h w 3"]

# Frame rate of pictures, and of videos whose header has none.
PICTURES_FPS = 25.0
LARGEST_FRAME_PX = 1 << 26  # twice an 8K frame
LARGEST_VIDEO_BYTES = 1 << 45  # so large because videos are decoded frame by frame
FASTEST_FPS = 1000.0  # a header with more is damaged
# Headers often announce one or two frames that do not exist.
MISSING_FRAMES_TOLERATED = 2
FRAMES_DECODED_AHEAD = 2


@final
@dataclass(frozen=True)
class FrameSource:
    """A video, or a sequence of pictures, that can be read several times."""

    path: Path  # the video, folder or pattern, for messages
    fps: float
    n_announced: int | None  # number of files, or of frames by the header; None if the header has no number
    pictures: tuple[Path, ...] = ()  # files of a folder or pattern; empty for a video

    def name_of(self, frame: int) -> str:
        """Returns the file name of a picture, or the number of a video's frame (from 0)."""
        return self.pictures[frame].name if self.pictures else str(frame)

    def frames(self) -> Iterator[Frame]:
        """Yields all frames in RGB, turned upright by their metadata.

        Raises:
            InputFileError: There is no frame, one cannot be decoded, or one differs from the first in size.
        """
        return (image for _, image in self.timed_frames())

    def timed_frames(self) -> Iterator[tuple[float, Frame]]:
        """Yields all frames with their times in seconds from the first, which come from the video or from ``fps``."""
        images = self._pictures() if self.pictures else _decoded(self.path, 1 / self.fps)
        first: tuple[int, ...] | None = None
        for index, (time_s, image) in enumerate(ahead(images, FRAMES_DECODED_AHEAD)):
            first = first or image.shape
            if image.shape != first:
                raise InputFileError(
                    f"{self.path}: expected frames of one size, {first[1]} x {first[0]} as the first, found "
                    f"{image.shape[1]} x {image.shape[0]} at frame {self.name_of(index)}; cut the clip there"
                )
            yield time_s, image
        if first is None:
            raise InputFileError(f"{self.path}: expected a video, found no frame in it that can be decoded")

    def _pictures(self) -> Iterator[tuple[float, Frame]]:
        return ((index / self.fps, read_photograph(path)) for index, path in enumerate(self.pictures))

    def is_cut_short(self, n_read: int) -> bool:
        """Whether frames that the header announced are missing."""
        return self.n_announced is not None and n_read < self.n_announced - MISSING_FRAMES_TOLERATED


def open_frames(path: Path) -> FrameSource:
    """Opens a video file, a folder of pictures, or a printf pattern such as ``frames/%05d.png``.

    Pictures of a folder are ordered by name, with numbers by their value. Those of a pattern start at the lowest number
    and must have no gaps.

    Raises:
        InputFileError: The path does not exist, or has no frame that can be decoded.
        UsageError: The path is a device or a pipe, which can be read only once.
    """
    if "%" in path.name and not path.exists():
        return _open_pattern(path)
    try:
        mode = path.stat().st_mode
    except OSError as error:
        raise InputFileError(f"{path}: expected a video or a folder of frames: {error.strerror}") from error
    if stat.S_ISDIR(mode):
        pictures = [own for own in path.iterdir() if own.suffix.lower() in IMAGE_SUFFIXES and own.is_file()]
        if not pictures:
            raise InputFileError(f"{path}: expected frames ({', '.join(IMAGE_SUFFIXES)}) in the folder, found none")
        return _of_pictures(path, sorted(pictures, key=by_number))
    if not stat.S_ISREG(mode):
        raise UsageError(f"{path}: expected a file, found a device or a pipe; write the video to a file first")
    return _open_video(path)


@final
class OverlayVideo:
    """Writes an MP4 file frame by frame.

    It is a context manager. The file gets its name when the block ends, also if it raises: the frames up to then are
    kept. If the disk is full, no file remains.

    Raises:
        UsageError: The file cannot be written.
    """

    def __init__(self, path: Path, fps: float) -> None:
        self._path, self._fps = path, fps
        # With the suffix at the end, from which FFmpeg takes the format.
        self._unfinished = path.with_name(f".{path.stem}.part{path.suffix}")
        self._writer: cv2.VideoWriter | None = None
        self._size = (0, 0)
        self._n_written = 0

    def __enter__(self) -> "OverlayVideo":
        return self

    def __exit__(self, *error: object) -> None:
        if self._writer is None:
            return
        self._writer.release()
        try:
            if _n_frames(self._unfinished) != self._n_written:  # OpenCV does not report a write that fails
                raise UsageError(
                    f"{self._path}: expected to write {self._n_written} frames, found that they cannot all be written; "
                    "is the disk full?"
                )
            if self._n_written:
                self._unfinished.replace(self._path)
        finally:
            self._unfinished.unlink(missing_ok=True)

    def write(self, image: Frame) -> None:
        """Appends a frame.

        Raises:
            UsageError: The file cannot be written.
        """
        if self._writer is None:
            # Codecs halve the colour planes, so the sides must be even.
            self._size = (image.shape[1] // 2 * 2, image.shape[0] // 2 * 2)
            code = cv2.VideoWriter.fourcc(*"mp4v")
            self._writer = cv2.VideoWriter(str(self._unfinished), code, self._fps, self._size)
            if not self._writer.isOpened():
                raise UsageError(f"{self._path}: expected to write a video of {self._size} pixels, OpenCV refuses")
        width, height = self._size
        self._writer.write(cv2.cvtColor(image[:height, :width], cv2.COLOR_RGB2BGR))
        self._n_written += 1


def _n_frames(video: Path) -> int:
    """Returns the number of frames in a video's header, which is written last; 0 if there is none."""
    capture = open_capture(video)
    try:
        return int(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0
    finally:
        capture.release()


def _open_pattern(pattern: Path) -> FrameSource:
    match = re.fullmatch(r"([^%]*)%(0?)(\d*)d([^%]*)", pattern.name)
    if match is None:
        raise UsageError(f"{pattern}: expected a pattern with one number, such as frame-%05d.png")
    numbered = re.compile(re.escape(match[1]) + r"(\d+)" + re.escape(match[4]))
    found: dict[int, Path] = {}
    for path in pattern.parent.iterdir() if pattern.parent.is_dir() else ():
        number = numbered.fullmatch(path.name)
        if number is not None and path.name == pattern.name % int(number[1]):
            found[int(number[1])] = path
    if not found:
        raise InputFileError(f"{pattern}: expected frames of this pattern, found none")
    numbers = sorted(found)
    missing = next((number for number in range(numbers[0], numbers[-1]) if number not in found), None)
    if missing is not None:
        raise InputFileError(f"{pattern}: expected frames without gaps, found no {pattern.name % missing}")
    return _of_pictures(pattern, [found[number] for number in numbers])


def _of_pictures(path: Path, pictures: Sequence[Path]) -> FrameSource:
    return FrameSource(path, PICTURES_FPS, len(pictures), tuple(pictures))


def by_number(path: Path) -> list[tuple[int, str]]:
    """Returns a sort key that orders numbers in file names by value: frame2 before frame10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]


def _open_video(path: Path) -> FrameSource:
    check_regular(path, "a video", LARGEST_VIDEO_BYTES)
    with _capture(path) as capture:
        fps = float(capture.get(cv2.CAP_PROP_FPS))
        count = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        if not capture.grab():
            raise InputFileError(f"{path}: expected a video, found no frame in it that can be decoded")
    return FrameSource(path, fps if 0 < fps <= FASTEST_FPS else PICTURES_FPS, count if count > 0 else None)


def _decoded(path: Path, usual_s: float) -> Iterator[tuple[float, Frame]]:
    """Yields times and frames. A frame without a valid time is put ``usual_s`` after the one before."""
    with _capture(path) as capture:
        start_s = before_s = None
        while True:
            is_there, image = capture.read()
            if not is_there:
                return
            time_s = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
            start_s = time_s if start_s is None else start_s
            if before_s is not None and not time_s - start_s > before_s:
                start_s = time_s - before_s - usual_s
            before_s = time_s - start_s
            yield before_s, np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))


@contextmanager
def _capture(path: Path) -> Iterator[cv2.VideoCapture]:
    capture = open_capture(path)
    try:
        if not capture.isOpened():
            raise InputFileError(
                f"{path}: expected a video that FFmpeg decodes, found {path.stat().st_size} bytes that are none"
            )
        width, height = (int(capture.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
        if width * height > LARGEST_FRAME_PX:
            raise InputFileError(
                f"{path}: expected frames of at most {LARGEST_FRAME_PX >> 20} megapixels, found {width} x {height}"
            )
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
        yield capture
    finally:
        capture.release()
