"""``pix2face track`` from end to end over drawn clips, with stand-ins for detector and network; and wrong calls."""

import csv
import json
import os
import signal
import sys
import threading
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

import cv2
import numpy as np
import pytest

from pix2face.commands import track_cli
from pix2face.commands.cli import main
from pix2face.detectors import detection
from pix2face.detectors.protocol import DetectedFace
from pix2face.evaluation.subjects.predictions_file import read_tracks
from pix2face.files.images import encode_image
from pix2face.geometry.landmarks import read_pts
from pix2face.inference.predictor import Predictor
from pix2face.models.morphable_model import MorphableModel
from pix2face.tracking import track_files
from pix2face.tracking.video import OverlayVideo, open_frames
from tests.full_disk import FULL, files_of_at_most
from tests.pix2face.coloured_faces import (
    HEIGHT_PX,
    WIDTH_PX,
    BlobDetector,
    camera_at,
    colour_predictor,
    draw_faces,
    true_landmarks,
)
from tests.pix2face.scene_readers import GltfScene, usd_pixels
from tests.synthetic_models import small_head_model

pytestmark = pytest.mark.usefixtures("stand_ins")
N_FRAMES = 8
CAMERAS = tuple(camera_at(50 + 4 * index, 60, yaw_deg=4.0 * index - 12) for index in range(N_FRAMES))


@pytest.fixture(scope="module")
def model() -> MorphableModel:
    return small_head_model()


@pytest.fixture(scope="module")
def frames(model, tmp_path_factory) -> Path:
    return write_frames(tmp_path_factory.mktemp("frames"), [draw_faces(model, [camera]) for camera in CAMERAS])


def write_frames(folder: Path, images: Iterable[np.ndarray]) -> Path:
    folder.mkdir(exist_ok=True)
    for index, image in enumerate(images):
        (folder / f"{index:04d}.png").write_bytes(encode_image(image))
    return folder


@pytest.fixture
def stand_ins(monkeypatch, model) -> None:
    """The command opens the small head, a network that reads colours, and a detector of blobs."""
    monkeypatch.setattr("pix2face.landmark_choice.landmark_file.open_model", lambda name: model)
    monkeypatch.setattr(Predictor, "load", lambda path, device=None: colour_predictor(model))
    monkeypatch.setattr(track_cli, "open_detector", lambda *call: BlobDetector())


def track(*arguments: object) -> int:
    return main(["track", *(str(own) for own in arguments), "--checkpoint", "stand-in"])


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def landmarks_of(row: dict[str, str]) -> np.ndarray:
    return np.array([[float(row[f"x{index}"]), float(row[f"y{index}"])] for index in range(68)])


def test_all_files_say_the_same_and_the_truth(tmp_path, frames, model, capsys):
    assert track(frames, "--out", tmp_path, "--write", "csv,npz,pts,video,glb,usdc", "--smoothing", "none") == 0
    rows = rows_of(tmp_path / "landmarks.csv")
    archive = np.load(tmp_path / "track.npz")
    summary = json.loads((tmp_path / "track.json").read_text())
    assert (summary["landmarks"], summary["silhouette"]) == ("model", True)
    assert [int(row["frame"]) for row in rows] == archive["frame"].tolist() == list(range(N_FRAMES))
    for index, (row, camera) in enumerate(zip(rows, CAMERAS, strict=True)):
        truth = true_landmarks(model, camera)
        assert np.abs(landmarks_of(row) - truth).max() < 0.3
        np.testing.assert_allclose(archive["landmarks2d"][index], landmarks_of(row), atol=1e-3)
        np.testing.assert_allclose(read_pts(tmp_path / "pts" / f"{index:06d}.pts"), landmarks_of(row), atol=2e-3)
        assert float(row["yaw_deg"]) == pytest.approx(4 * index - 12, abs=0.5)
        assert row["box"] == "detected"
        assert row["fit"] == "fitted"
        assert float(row["time_s"]) == pytest.approx(index / 25, abs=1e-4)
        assert float(row["score"]) == archive["score"][index] == 2.0
        vertices = model.landmarks["ibug68"]
        for pixels in (
            GltfScene(tmp_path / "track.glb").pixels((HEIGHT_PX, WIDTH_PX), index),
            usd_pixels(tmp_path / "track.usdc", (HEIGHT_PX, WIDTH_PX), index),
        ):
            np.testing.assert_allclose(pixels[vertices], archive["landmarks2d_raw"][index], atol=2e-3)
    assert archive["landmarks3d"].shape == (N_FRAMES, 68, 3)
    assert archive["identity"].tolist() == summary["faces"][0]["identity"]
    assert str(archive["model_name"]) == model.name
    names = {f"{tmp_path.name}/{index + 1:06d}" for index in range(N_FRAMES)}
    measured = read_tracks(tmp_path.parent, names, {})  # as `evaluate --tracks` reads it
    np.testing.assert_array_equal(measured.landmarks2d, archive["landmarks2d"])
    np.testing.assert_array_equal(measured.pose_deg, archive["pose_deg"])
    (face,) = summary["faces"]
    assert (face["frames"], face["frames_detected"], face["frames_carried"]) == (N_FRAMES, N_FRAMES, 0)
    assert face["jitter_percent_raw"] == face["jitter_percent_smoothed"] > 0
    overlay = list(open_frames(tmp_path / "overlay.mp4").frames())
    assert len(overlay) == N_FRAMES
    assert overlay[0].shape == (HEIGHT_PX, WIDTH_PX, 3)
    original = cv2.cvtColor(cv2.imread(str(frames / "0000.png")), cv2.COLOR_BGR2RGB)
    assert (np.abs(overlay[0].astype(int) - original).max(axis=2) > 60).sum() > 100  # dots
    assert "jitter" in capsys.readouterr().err


def test_a_clip_that_starts_blank_has_no_landmarks_there(tmp_path, frames, capsys):
    blank = np.full((HEIGHT_PX, WIDTH_PX, 3), 90, np.uint8)
    clip = write_frames(tmp_path / "clip", [*[blank] * 3, *islice(open_frames(frames).frames(), 3)])
    assert track(clip, "--out", tmp_path / "out", "--write", "csv,npz,pts,video") == 0
    rows = rows_of(tmp_path / "out" / "landmarks.csv")
    assert [row["fit"] for row in rows] == ["none"] * 3 + ["fitted"] * 3
    assert [row["x0"] == row["yaw_deg"] == "" for row in rows] == [True] * 3 + [False] * 3
    archive = np.load(tmp_path / "out" / "track.npz")
    for name in ("landmarks2d", "landmarks3d", "camera", "pose_deg"):
        found = np.isfinite(archive[name].reshape(6, -1)).all(axis=1)
        assert found.tolist() == [False] * 3 + [True] * 3
    assert sorted(path.name for path in (tmp_path / "out" / "pts").iterdir()) == [f"{i:06d}.pts" for i in (3, 4, 5)]
    names = {f"out/{index + 1:06d}" for index in range(6)}
    assert read_tracks(tmp_path, names, {}).names == ("out/000004", "out/000005", "out/000006")
    assert "3 frames without a face" in capsys.readouterr().err


def test_a_video_gives_what_its_frames_give(tmp_path, frames):
    with OverlayVideo(tmp_path / "a.mp4", 25) as video:
        for image in open_frames(frames).frames():
            video.write(image)
    for name, source in (("f", frames), ("p", frames / "%04d.png"), ("v", tmp_path / "a.mp4")):
        assert track(source, "--out", tmp_path / name, "--write", "csv") == 0
    folder, pattern, film = (rows_of(tmp_path / name / "landmarks.csv") for name in "fpv")
    assert folder == pattern
    assert len(film) == N_FRAMES
    for a, b in zip(pattern, film, strict=True):  # colours, which are the geometry here, suffer from the codec
        assert np.abs(landmarks_of(a) - landmarks_of(b)).mean() < 3


def test_its_own_boxes_can_be_given_back(tmp_path, frames):
    assert track(frames, "--out", tmp_path / "a", "--write", "csv") == 0
    assert track(frames, "--out", tmp_path / "b", "--write", "csv", "--boxes", tmp_path / "a" / "boxes.csv") == 0
    found, given = (rows_of(tmp_path / name / "landmarks.csv") for name in "ab")
    assert {row.pop("score") for row in found} == {"2"}
    assert {row.pop("score") for row in given} == {""}
    assert found == given


def test_boxes_of_a_few_frames_lead_through_the_whole_clip(tmp_path, frames):
    with OverlayVideo(tmp_path / "slow.mp4", 1) as video:  # a detector's face would be lost after two frames
        for image in open_frames(frames).frames():
            video.write(image)
    assert track(frames, "--out", tmp_path / "a", "--write", "csv") == 0
    lines = (tmp_path / "a" / "boxes.csv").read_text().splitlines()
    some = tmp_path / "some.csv"
    some.write_text("\n".join([lines[0], *(lines[1 + frame] for frame in (0, 3, 7))]))
    assert track(tmp_path / "slow.mp4", "--out", tmp_path / "b", "--write", "csv", "--boxes", some) == 0
    flags = [row["box"] for row in rows_of(tmp_path / "b" / "landmarks.csv")]
    assert flags == ["detected" if frame in (0, 3, 7) else "interpolated" for frame in range(N_FRAMES)]


def test_frames_without_a_detection_are_flagged(tmp_path, frames, monkeypatch):
    def find(index: int, image: np.ndarray) -> list[DetectedFace]:
        return [] if index in (0, 3, 4, 7) else BlobDetector().candidates(image)

    monkeypatch.setattr(track_cli, "_finder", lambda config, source: find)
    assert track(frames, "--out", tmp_path, "--write", "csv,npz") == 0
    flags = [row["box"] for row in rows_of(tmp_path / "landmarks.csv")]
    assert flags == ["held", "detected", "detected", "interpolated", "interpolated", "detected", "detected", "held"]
    archive = np.load(tmp_path / "track.npz")
    assert [str(archive["box_sources"][own]) for own in archive["box_source"]] == flags


def two_faces(model, folder: Path, n_frames: int) -> Path:
    cameras = [(camera_at(40 + index, 50), camera_at(120, 70, scale=0.3)) for index in range(n_frames)]
    return write_frames(folder, [draw_faces(model, own) for own in cameras])


def test_all_faces_get_a_folder_each_and_one_overlay(tmp_path, model):
    source = two_faces(model, tmp_path / "frames", 5)
    assert track(source, "--out", tmp_path / "out", "--all-faces", "--smoothing", "spline") == 0
    first, second = (rows_of(tmp_path / "out" / f"face-{index}" / "landmarks.csv") for index in range(2))
    assert len(first) == len(second) == 5
    assert abs(landmarks_of(first[0])[:, 0].mean() - 40) < 5
    assert abs(landmarks_of(second[0])[:, 0].mean() - 120) < 5
    assert len(list(open_frames(tmp_path / "out" / "overlay.mp4").frames())) == 5


def test_nothing_of_an_earlier_run_is_left(tmp_path, model):
    out, source = tmp_path / "out", two_faces(model, tmp_path / "frames", 3)
    assert track(source, "--out", out, "--all-faces", "--write", "csv,pts,video") == 0
    (out / "face-1" / "notes.txt").touch()
    (out / "face-to-face").mkdir()
    assert track(source, "--out", out, "--write", "csv") == 0
    left = {str(path.relative_to(out)) for path in out.rglob("*")}
    assert left == {"boxes.csv", "landmarks.csv", "track.json", "face-1", "face-1/notes.txt", "face-to-face"}


def test_files_are_open_while_their_face_is_in_the_picture(tmp_path, model, monkeypatch):
    left, right = (draw_faces(model, [own]) for own in (camera_at(40, 50), camera_at(120, 70, scale=0.3)))
    source = write_frames(tmp_path / "frames", [*[left] * 4, *[right] * 4, *[left] * 4])  # one after the other
    n_open = most = 0
    monkeypatch.setattr("pix2face.tracking.face_tracks.LONGEST_GAP_SECONDS", 0)
    begin, end = track_files.GrowingNpz.__enter__, track_files.GrowingNpz.__exit__

    def counted_begin(self):
        nonlocal n_open, most
        n_open += 1
        most = max(most, n_open)
        return begin(self)

    def counted_end(self, *error):
        nonlocal n_open
        n_open -= 1
        end(self, *error)

    monkeypatch.setattr(track_files.GrowingNpz, "__enter__", counted_begin)
    monkeypatch.setattr(track_files.GrowingNpz, "__exit__", counted_end)
    assert track(source, "--out", tmp_path / "out", "--all-faces", "--write", "csv,npz", "--smoothing", "spline") == 0
    assert [len(rows_of(path)) for path in sorted((tmp_path / "out").glob("face-*/landmarks.csv"))] == [4, 4, 4]
    assert (n_open, most) == (0, 1)


def test_a_clip_of_one_frame(tmp_path, model):
    source = write_frames(tmp_path / "frames", [draw_faces(model, [camera_at(60, 60)])])
    assert track(source, "--out", tmp_path / "out", "--smoothing", "spline") == 0
    assert len(rows_of(tmp_path / "out" / "landmarks.csv")) == 1
    assert json.loads((tmp_path / "out" / "track.json").read_text())["faces"][0]["jitter_percent_raw"] is None


def test_a_face_cut_by_the_border_is_tracked(tmp_path, model):
    cameras = [camera_at(8 + index, 60) for index in range(4)]
    source = write_frames(tmp_path / "frames", [draw_faces(model, [camera]) for camera in cameras])
    assert track(source, "--out", tmp_path / "out", "--write", "csv") == 0
    rows = rows_of(tmp_path / "out" / "landmarks.csv")
    assert np.abs(landmarks_of(rows[0]) - true_landmarks(model, cameras[0])).max() < 2


def test_a_tiny_face_is_tracked_with_a_warning(tmp_path, model, capsys):
    source = write_frames(tmp_path / "frames", [draw_faces(model, [camera_at(60, 60, scale=0.12)])] * 4)
    assert track(source, "--out", tmp_path / "out", "--write", "csv") == 0
    assert "px large; below 40" in capsys.readouterr().err
    assert len(rows_of(tmp_path / "out" / "landmarks.csv")) == 4


def test_no_face_in_the_whole_clip_is_one_error(tmp_path, capsys):
    source = write_frames(tmp_path / "frames", [np.zeros((40, 60, 3), dtype=np.uint8)] * 3)
    assert track(source, "--out", tmp_path / "out") == 2
    assert "expected a face, found none by the detector cnn in 3 frames" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--write", "mov"], "expected --write of csv, npz, pts, video"),
        (["--write", ","], "expected --write of"),
        (["--write", "usdc", "--camera", "affine"], "expected another --camera than affine for --write glb or usdc"),
        (["--write", "arkit"], "without eyeBlinkLeft; take the built-in model"),
        (["--detect-every", "0"], "expected --detect-every of 1 or more"),
        (["--identity-frames", "0"], "expected --identity-frames of 1 or more"),
        (["--regularisation", "-1"], "expected a positive --regularisation"),
        (["--boxes", "none.csv"], "found no such file"),
    ],
)
def test_wrong_options_are_one_line(tmp_path, frames, capsys, options, words):
    assert track(frames, "--out", tmp_path / "out", *options) == 2
    error = capsys.readouterr().err
    assert words in error
    assert len(error.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_usd_without_its_extra_is_named_at_once(tmp_path, frames, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr.Usd", None)
    assert track(frames, "--out", tmp_path / "out", "--write", "csv,usdc") == 2
    assert "expected the package usd-core, which USD needs; run: pip install 'pix2face[usd]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("content", [b"", b"some text\n" * 100])
def test_a_file_that_is_no_video_is_one_line(tmp_path, capfd, content):
    (tmp_path / "a.mp4").write_bytes(content)
    assert track(tmp_path / "a.mp4", "--out", tmp_path / "out") == 2
    lines = [line for line in capfd.readouterr().err.splitlines() if line.startswith("pix2face")]
    assert len(lines) == 1
    assert "expected a video" in lines[0]


def test_an_unknown_detector_is_refused(tmp_path, frames, monkeypatch, capsys):
    monkeypatch.setattr(track_cli, "open_detector", detection.open_detector)
    assert track(frames, "--out", tmp_path, "--detector", "haar") == 2
    assert f"expected a detector of {', '.join(detection.DETECTORS)}" in capsys.readouterr().err


def test_an_interruption_keeps_what_is_done(tmp_path, frames, monkeypatch, request):
    written = []
    original = track_cli.TrackFiles.write
    # What a shell starts in the background ignores the signal, tests included.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    request.addfinalizer(lambda: signal.signal(signal.SIGINT, before))

    def write(self, face, time_s) -> None:
        original(self, face, time_s)
        written.append(face.box.frame)
        if len(written) == 4:
            assert threading.current_thread() is threading.main_thread()
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(track_cli.TrackFiles, "write", write)
    assert track(frames, "--out", tmp_path, "--write", "csv,npz,video", "--smoothing", "none") == 130
    assert 4 <= len(rows_of(tmp_path / "landmarks.csv")) < N_FRAMES
    archive = np.load(tmp_path / "track.npz")
    assert len(archive["landmarks2d"]) == len(rows_of(tmp_path / "landmarks.csv"))
    assert json.loads((tmp_path / "track.json").read_text())["faces"][0]["frames"] >= 3
    assert not list(tmp_path.glob(".*part"))
    assert len(list(open_frames(tmp_path / "overlay.mp4").frames())) >= 3


@pytest.mark.parametrize(
    ("write", "n_bytes", "name", "reason"),
    [
        ("csv", 100, "boxes.csv", FULL),
        ("csv", 5000, "landmarks.csv", FULL),
        ("npz", 5000, "track.npz", FULL),
        ("pts", 500, "pts/000000.pts", FULL),
        ("glb", 5000, "track.glb", FULL),
        ("usdc", 5000, "track.usdc", FULL),
        ("video", 5000, "overlay.mp4", "is the disk full?"),
    ],
)
def test_a_full_disk_is_one_line_and_leaves_no_half_file(
    tmp_path, frames, write, n_bytes, name, reason, capsys, monkeypatch
):
    (tmp_path / "track.json").touch()  # not written anew: it would not fit either
    monkeypatch.setattr(track_cli, "write_file", lambda path, text: None)
    with files_of_at_most(n_bytes):
        assert track(frames, "--out", tmp_path, "--write", write) == 2
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith("pix2face: error: ")
    assert str(tmp_path / name) in line
    assert reason in line
    left = {path.name for path in tmp_path.rglob("*") if path.is_file()}
    assert left - {"boxes.csv", "track.json"} == set()
    assert (tmp_path / "boxes.csv").exists() == (name != "boxes.csv")
