"""Frames of videos, folders and patterns; what is no video; the overlay opens again."""

import os
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from pix2face.errors import InputFileError, UsageError
from pix2face.files.images import encode_image, open_capture
from pix2face.tracking.video import OverlayVideo, open_frames


def drawn(index: int, height: int = 48, width: int = 64) -> np.ndarray:
    """A red upper left corner on grey that gets brighter frame by frame."""
    image = np.full((height, width, 3), 40 + 10 * index, dtype=np.uint8)
    image[: height // 2, : width // 2] = (220, 20, 20)
    return image


def write_video(path: Path, n_frames: int = 6, fps: float = 10.0, size: tuple[int, int] = (48, 64)) -> Path:
    with OverlayVideo(path, fps) as video:
        for index in range(n_frames):
            video.write(drawn(index, *size))
    return path


def write_frames(folder: Path, names: list[str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for index, name in enumerate(names):
        (folder / name).write_bytes(encode_image(drawn(index)))


def test_a_written_video_opens_again_with_its_frames_and_colours(tmp_path):
    source = open_frames(write_video(tmp_path / "a.mp4"))
    frames = list(source.frames())
    assert (len(frames), source.n_announced, source.fps) == (6, 6, 10.0)
    assert not source.is_cut_short(6)
    for index, frame in enumerate(frames):
        np.testing.assert_allclose(frame[5:15, 5:20].mean(axis=(0, 1)), (220, 20, 20), atol=12)
        np.testing.assert_allclose(frame[30:44, 40:60].mean(axis=(0, 1)), 40 + 10 * index, atol=6)
    assert len(list(source.frames())) == 6  # and again


def test_ffmpeg_reads_the_same_frames(tmp_path):
    av = pytest.importorskip("av", reason="pip install 'pix2face[dev]'")
    path = write_video(tmp_path / "a.mp4")
    with av.open(str(path)) as video:
        (stream,) = video.streams
        assert (stream.frames, stream.average_rate, stream.codec_context.name) == (6, 10, "mpeg4")
        assert stream.format.name == "yuv420p"
        found = [(frame.time, frame.to_ndarray(format="rgb24")) for frame in video.decode(stream)]
    ours = list(open_frames(path).timed_frames())
    assert [time for time, _ in found] == pytest.approx([time for time, _ in ours])
    for (_, theirs), (_, frame) in zip(found, ours, strict=True):
        np.testing.assert_allclose(theirs.astype(int), frame, atol=8)


def test_times_are_those_of_the_frames(tmp_path):
    path = write_video(tmp_path / "a.mp4")
    assert [time for time, _ in open_frames(path).timed_frames()] == pytest.approx([0.1 * index for index in range(6)])
    content = bytearray(path.read_bytes())
    place = content.find(b"stts") + 8  # how long frames are shown: one entry for all of them
    count, n_frames, ticks = struct.unpack_from(">3I", content, place)
    assert (count, n_frames) == (1, 6)
    table = content.find(b"stbl") - 4
    # The same table with two entries is 8 bytes longer, and so are the boxes around it.
    content[place : place + 12] = struct.pack(">5I", 2, 3, ticks // 2, 3, ticks // 2 * 3)
    for box in (b"moov", b"trak", b"mdia", b"minf", b"stbl", b"stts"):
        at = content.find(box) - 4
        struct.pack_into(">I", content, at, struct.unpack_from(">I", content, at)[0] + 8)
    assert table > content.find(b"mdat")  # so the frames stay where they are
    (tmp_path / "b.mp4").write_bytes(content)
    times = [time for time, _ in open_frames(tmp_path / "b.mp4").timed_frames()]
    assert times == pytest.approx([0, 0.05, 0.1, 0.15, 0.3, 0.45], abs=1e-3)


def test_times_of_pictures_follow_their_rate(tmp_path):
    write_frames(tmp_path / "f", ["1.png", "2.png", "3.png"])
    assert [time for time, _ in open_frames(tmp_path / "f").timed_frames()] == [0, 0.04, 0.08]


def test_odd_sides_lose_a_pixel(tmp_path):
    frames = list(open_frames(write_video(tmp_path / "a.mp4", size=(49, 65))).frames())
    assert frames[0].shape == (48, 64, 3)


def test_rotation_metadata_is_followed(tmp_path):
    content = bytearray(write_video(tmp_path / "a.mp4").read_bytes())
    header = content.find(b"tkhd") + 4
    assert content[header] == 0  # version
    one, frac = 1 << 16, 1 << 30
    content[header + 40 : header + 76] = struct.pack(">9i", 0, one, 0, -one, 0, 0, 0, 0, frac)  # a quarter clockwise
    (tmp_path / "turned.mp4").write_bytes(content)
    frame = next(open_frames(tmp_path / "turned.mp4").frames())
    assert frame.shape == (64, 48, 3)
    np.testing.assert_allclose(frame[5:20, 34:44].mean(axis=(0, 1)), (220, 20, 20), atol=12)  # upper right now


def test_a_folder_is_read_in_the_order_of_its_numbers(tmp_path):
    write_frames(tmp_path / "f", ["f10.png", "f9.png", "f1.png"])
    (tmp_path / "f" / "notes.txt").write_text("no frame")
    source = open_frames(tmp_path / "f")
    assert [path.name for path in source.pictures] == ["f1.png", "f9.png", "f10.png"]
    assert [int(frame[-1, -1, 0]) for frame in source.frames()] == [60, 50, 40]
    assert source.name_of(1) == "f9.png"


def test_a_pattern_is_read_from_its_lowest_number(tmp_path):
    write_frames(tmp_path, ["f_0007.png", "f_0008.png", "f_9.png", "g_0001.png"])
    source = open_frames(tmp_path / "f_%04d.png")
    assert [path.name for path in source.pictures] == ["f_0007.png", "f_0008.png"]
    assert len(list(source.frames())) == 2


@pytest.mark.parametrize(
    ("pattern", "words"),
    [("h_%04d.png", "found none"), ("f_%04d.png", "without gaps, found no f_0002.png"), ("none/%d.png", "found none")],
)
def test_patterns_without_frames_or_with_gaps_are_refused(tmp_path, pattern, words):
    write_frames(tmp_path, ["f_0001.png", "f_0003.png"])
    with pytest.raises(InputFileError, match=words):
        open_frames(tmp_path / pattern)


def test_a_pattern_of_two_numbers_is_refused(tmp_path):
    with pytest.raises(UsageError, match="one number"):
        open_frames(tmp_path / "%d_%d.png")


@pytest.mark.parametrize("content", [b"", b"This is a text file.\n" * 50, bytes(range(256)) * 100])
@pytest.mark.parametrize("name", ["a.mp4", "a.avi"])
def test_files_that_are_no_video_are_refused(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputFileError, match=rf"a\.(mp4|avi): expected a video.*found {len(content)} bytes"):
        open_frames(tmp_path / name)


def test_a_busy_machine_may_take_any_time_to_read_a_video(tmp_path, monkeypatch):
    nothing, given = cv2.VideoCapture(), []
    monkeypatch.setattr("cv2.VideoCapture", lambda name, backend, options: given.extend(options) or nothing)
    open_capture(tmp_path / "a.mp4")
    limits = dict(zip(given[::2], given[1::2], strict=True))
    assert limits == {cv2.CAP_PROP_OPEN_TIMEOUT_MSEC: 0, cv2.CAP_PROP_READ_TIMEOUT_MSEC: 0}  # OpenCV's are 30 s


def test_a_cut_off_video_says_so(tmp_path):
    noise = np.random.default_rng(0)
    writer = cv2.VideoWriter(str(tmp_path / "a.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    for _ in range(40):
        writer.write(noise.integers(0, 256, (48, 64, 3), dtype=np.uint8))
    writer.release()
    content = (tmp_path / "a.avi").read_bytes()
    (tmp_path / "cut.avi").write_bytes(content[: len(content) // 2])
    source = open_frames(tmp_path / "cut.avi")
    n_read = len(list(source.frames()))
    assert 10 < n_read < 30
    assert source.n_announced is None or source.is_cut_short(n_read)


def test_frames_of_changing_size_are_refused_where_they_change(tmp_path):
    write_frames(tmp_path / "f", ["1.png", "2.png"])
    (tmp_path / "f" / "3.png").write_bytes(encode_image(drawn(0, 30, 40)))
    frames = open_frames(tmp_path / "f").frames()
    next(frames)
    next(frames)
    with pytest.raises(InputFileError, match=r"one size, 64 x 48 as the first, found 40 x 30 at frame 3\.png"):
        next(frames)


def test_nothing_and_an_empty_folder_are_refused(tmp_path):
    with pytest.raises(InputFileError, match="No such file"):
        open_frames(tmp_path / "none.mp4")
    with pytest.raises(InputFileError, match="in the folder, found none"):
        open_frames(tmp_path)


def test_a_pipe_is_refused_and_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.mp4")
    with pytest.raises(UsageError, match="a device or a pipe"):
        open_frames(tmp_path / "pipe.mp4")


def test_an_overlay_that_cannot_be_written_is_an_error(tmp_path):
    with (
        pytest.raises(UsageError, match="expected to write a video"),
        OverlayVideo(tmp_path / "no" / "a.mp4", 10) as video,
    ):
        video.write(drawn(0))


def test_clips_at_hand_have_the_frames_that_players_show(shared_dir):
    assert len(list(open_frames(shared_dir / "data" / "video" / "obama.mp4").frames())) == 55
