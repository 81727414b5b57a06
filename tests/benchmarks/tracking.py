"""What smoothing does to landmarks, and what tracking takes: python -m tests.benchmarks.tracking.

    python -m tests.benchmarks.tracking [--tracks A/track.npz,B/track.npz] [--out out/tracking.json]
    python -m tests.benchmarks.tracking --clip CLIP [--out out/tracking.json]

Prints and writes JSON, with ``--clip`` only the last:

- ``smoothing``: for each smoother, on points that move as faces do (swings of 0.3 to 3 Hz, up to a quarter of the eye
  distance) with normal noise of 1 % of the eye distance: jitter before and after, RMS error against the truth, lag in
  frames behind a swing of 1 Hz, what is left of the height of swings of 1, 3 and 5 Hz, and the delay in frames.
- ``clips``: of clips that ``pix2face track`` has tracked, the jitter of the raw landmarks after each smoother, and
  where the boxes come from.
- ``memory``: the largest memory of a process that tracks a drawn clip once, and 20 times over.
- ``speed``: of ``pix2face track CLIP``: frames a second of each pass and of all, processor time of each step in ms per
  frame of the clip, and the time of the whole command, which also starts and loads the network.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy import ndarray

from pix2face.commands import track_cli
from pix2face.commands.cli import main as pix2face_main
from pix2face.detectors.centre_detector import CentreDetector
from pix2face.inference.onnx_session import OnnxSession
from pix2face.inference.predictor import Predictor
from pix2face.photographs import refined_detection
from pix2face.tracking import clip_fit, track_files
from pix2face.tracking.smoothing import SMOOTHINGS, JitterMeter, open_smoother
from pix2face.tracking.track_files import TrackFiles
from pix2face.tracking.video import OverlayVideo, open_frames
from tests.benchmarks.measuring import StepTimes, options_parser, write_report

FPS = 25.0
NOISE = 0.01
LOOPS = 20

PASSES = (
    ("boxes", track_cli, "_detect"),
    ("identity", track_cli, "find_identities"),
    ("fits", track_cli, "_follow"),
)
STEPS = (
    ("detect", CentreDetector, "candidates"),
    ("crops, and maps from planes", Predictor, "predict_batch"),
    ("network", OnnxSession, "run"),
    ("first predictions", refined_detection, "refined_boxes"),
    ("fits of second predictions", clip_fit, "measure_picture"),
    ("visible landmarks", track_files, "visible_landmarks"),
    ("landmarks.csv and track.npz", TrackFiles, "write"),
    ("overlay.mp4", track_cli, "draw_frame"),
    ("overlay.mp4", OverlayVideo, "write"),
)


def smooth(kind: str, points: ndarray, units: ndarray, fps: float = FPS) -> ndarray:
    """All frames through a smoother."""
    smoother = open_smoother(kind, fps)
    done = [own for frame, unit in zip(points, units, strict=True) for own in smoother.push(frame, float(unit))]
    return np.stack(done + smoother.flush())


def jitter_percent(points: ndarray, units: ndarray) -> float:
    """Mean second difference, % of the eye distance."""
    meter = JitterMeter()
    for frame, unit in zip(points, units, strict=True):
        meter.push(frame, float(unit))
    return round(100 * (meter.share or 0.0), 3)


def drawn_motion(n_frames: int, seed: int = 0) -> ndarray:
    """68 points that swing at several frequencies, in eye distances."""
    rng, seconds = np.random.default_rng(seed), np.arange(n_frames) / FPS
    points = np.zeros((n_frames, 68, 2))
    for hertz, height in ((0.3, 0.25), (1.0, 0.1), (3.0, 0.02)):
        phase = rng.uniform(0, 2 * np.pi, (68, 2))
        points += height * np.sin(2 * np.pi * hertz * seconds[:, None, None] + phase)
    return points


def response(kind: str, hertz: float) -> complex:
    """What is left of a swing of 0.1 eye distances: height (absolute value) and lag (angle)."""
    seconds = np.arange(500) / FPS
    wave = np.exp(-2j * np.pi * hertz * seconds)
    swing = np.tile(0.1 * np.sin(2 * np.pi * hertz * seconds)[:, None, None], (1, 1, 2))
    after = smooth(kind, swing, np.ones(500))[100:400, 0, 0] @ wave[100:400]
    return complex(after / (swing[100:400, 0, 0] @ wave[100:400]))


def measure_smoother(kind: str) -> dict[str, float]:
    """The figures of one smoother on drawn motion."""
    truth, units = drawn_motion(1500), np.ones(1500)
    noisy = truth + np.random.default_rng(1).normal(0, NOISE, truth.shape)
    after = smooth(kind, noisy, units)
    one = response(kind, 1.0)
    return {
        "jitter_percent_before": jitter_percent(noisy, units),
        "jitter_percent_after": jitter_percent(after, units),
        "jitter_percent_of_the_truth": jitter_percent(truth, units),
        "error_percent_before": round(100 * float(np.sqrt(((noisy - truth) ** 2).sum(axis=2).mean())), 3),
        "error_percent_after": round(100 * float(np.sqrt(((after - truth) ** 2).sum(axis=2).mean())), 3),
        "lag_frames": round(-float(np.angle(one)) / (2 * np.pi) * FPS, 2),
        **{f"left_of_{hertz:g}_hz": round(abs(response(kind, hertz)), 3) for hertz in (1.0, 3.0, 5.0)},
        "delay_frames": open_smoother(kind, FPS).delay,
    }


def measure_track(path: Path) -> dict[str, object]:
    """Smooths the raw landmarks of a tracked clip in every way."""
    with np.load(path, allow_pickle=False) as archive:
        points, units = archive["landmarks2d_raw"].astype(np.float64), archive["eye_px"]
        names = archive["box_sources"]
        counts = np.bincount(archive["box_source"], minlength=len(names))
        fps, n_fitted = float(archive["fps"]), int(archive["is_fitted"].sum())
    return {
        "frames": len(points),
        **{f"frames_{name}": int(count) for name, count in zip(names, counts, strict=True)},
        "frames_fitted": n_fitted,
        "jitter_percent": {kind: jitter_percent(smooth(kind, points, units, fps), units) for kind in SMOOTHINGS},
    }


def track_drawn_clip(loops: int, folder: Path) -> float:
    """Tracks a drawn clip of 30 frames so many times over; the largest memory of this process so far, in MB."""
    from pix2face.files.images import encode_image
    from tests.pix2face.coloured_faces import BlobDetector, camera_at, colour_predictor, draw_faces
    from tests.synthetic_models import small_head_model

    model = small_head_model()
    contents = [
        encode_image(draw_faces(model, [camera_at(50 + index, 60, yaw_deg=index - 15.0)])) for index in range(30)
    ]
    contents += contents[::-1]
    frames = folder / "frames"
    frames.mkdir()
    for index in range(loops * len(contents)):
        (frames / f"{index:06d}.png").write_bytes(contents[index % len(contents)])
    track_cli.open_model_with = lambda name, landmarks: model
    track_cli.open_detector = lambda *call: BlobDetector()  # type: ignore[assignment]
    Predictor.load = lambda path, device=None: colour_predictor(model)  # type: ignore[method-assign,assignment]
    if pix2face_main(["track", str(frames), "--out", str(folder / "out"), "--checkpoint", "none"]):
        raise SystemExit("tracking failed")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def measure_memory() -> dict[str, float]:
    """Megabytes of a process of its own that tracks a clip once, and one that does so 20 times over."""
    megabytes = {}
    for loops in (1, LOOPS):
        command = [sys.executable, "-m", "tests.benchmarks.tracking", "--only-memory", str(loops)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        megabytes[loops] = float(done.stdout)
    return {
        "megabytes_once": round(megabytes[1], 1),
        f"megabytes_{LOOPS}_times": round(megabytes[LOOPS], 1),
        "ratio": round(megabytes[LOOPS] / megabytes[1], 3),
    }


def measure_speed(clip: Path, folder: Path) -> dict[str, object]:
    """Tracks a clip twice: as a command, and here with a clock at each step."""
    command = [sys.executable, "-m", "pix2face.commands.cli", "track", str(clip), "--out", str(folder / "command")]
    start_s = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    command_s, spent = time.perf_counter() - start_s, resource.getrusage(resource.RUSAGE_CHILDREN)
    source = open_frames(clip)
    start_s = time.process_time()
    n_frames = sum(1 for _ in source.frames())
    decoding_s = time.process_time() - start_s
    passes, steps = StepTimes(time.perf_counter), StepTimes()
    with passes.of(PASSES), steps.of(STEPS):
        start_s = time.process_time()
        if pix2face_main(["track", str(clip), "--out", str(folder / "steps")]):
            raise SystemExit("tracking failed")
        processor_s = time.process_time() - start_s
    pass_s = {name: sum(calls) for name, calls in passes.seconds.items()}
    step_s = {name: sum(calls) for name, calls in steps.seconds.items()} | {"decode (three times)": 3 * decoding_s}
    step_s["load the network, and all else"] = processor_s - sum(step_s.values())
    return {
        "frames": n_frames,
        "frames_per_second": {
            **{name: round(n_frames / seconds, 1) for name, seconds in pass_s.items()},
            "all passes": round(n_frames / sum(pass_s.values()), 1),
            "command": round(n_frames / command_s, 1),
        },
        "command_s": round(command_s, 2),
        "command_processor_s": round(spent.ru_utime + spent.ru_stime, 2),
        "processor_ms_per_frame": {name: round(1000 * own / n_frames, 2) for name, own in step_s.items()},
    }


def main() -> None:
    """Measures and writes."""
    parser = options_parser(__doc__, Path("out/tracking.json"))
    parser.add_argument("--tracks", default="")
    parser.add_argument("--clip", type=Path)
    parser.add_argument("--only-memory", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        if options.only_memory:
            sys.stdout.write(f"{track_drawn_clip(options.only_memory, Path(name))}\n")
            return
        if options.clip is not None:
            speed = measure_speed(options.clip, Path(name))
            write_report({"speed": speed}, options.out)
            return
        report: dict[str, object] = {"smoothing": {kind: measure_smoother(kind) for kind in SMOOTHINGS}}
        tracks = [Path(own) for own in options.tracks.split(",") if own]
        report["clips"] = {own.parent.name: measure_track(own) for own in tracks}
        report["memory"] = measure_memory()
    write_report(report, options.out)


if __name__ == "__main__":
    main()
