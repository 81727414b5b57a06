"""The command ``pix2face track``, which writes landmarks, poses and identities of faces in a video, and an overlay."""

import json
import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import get_args

import cv2
from jaxtyping import UInt8
from numpy import ndarray
from rich.console import Console

from pix2face.command_line import check_output_folder, counted, prepare_output_folder, progress_bar, say
from pix2face.commands.pix2face_config import TrackConfig
from pix2face.detectors.detection import open_detector
from pix2face.detectors.protocol import Box, sure_faces
from pix2face.errors import InputFileError, UsageError
from pix2face.face_files.box_files import read_box_file
from pix2face.files.writing import GrowingFile, write_file
from pix2face.inference.onnx_session import keep_networks_in_one_thread
from pix2face.inference.predictor import Predictor
from pix2face.landmark_choice.landmark_file import open_model_with, with_own_landmarks
from pix2face.photographs.usd_files import usd_module
from pix2face.tracking import TrackFormat
from pix2face.tracking.clip_fit import FrameFitter
from pix2face.tracking.clip_identity import find_identities, identity_step
from pix2face.tracking.export.blendshapes import BlendshapeSolver
from pix2face.tracking.face_follower import FaceFollower, find_boxes, follow_faces
from pix2face.tracking.face_tracks import (
    LEAST_SHARE_DETECTED,
    FaceTracker,
    TrackSummary,
    boxes_of_every_frame,
    lasting_faces,
    main_face,
)
from pix2face.tracking.smoothing import open_smoother
from pix2face.tracking.track_files import OVERLAY_NAME, TrackFiles, draw_frame, remove_earlier_files
from pix2face.tracking.track_summary import ClipFace, face_report, face_summary
from pix2face.tracking.video import FrameSource, OverlayVideo, open_frames

console = Console(stderr=True)

Find = Callable[[int, UInt8[ndarray, "_ _ 3"]], Sequence[Box] | None]

# Smaller faces are enlarged so much for the network that their maps are inaccurate.
SMALL_FACE_PX = 40.0


def track(config: TrackConfig) -> int:
    """Runs ``pix2face track``."""
    formats = _check_call(config)
    _silence_decoders()
    keep_networks_in_one_thread()  # the passes decode, predict and fit in threads of their own
    source = open_frames(config.video)
    find = _finder(config, source)
    check_output_folder(config.out)
    network = config.faces.network
    model = open_model_with(network.model, network.landmarks)
    predictor = Predictor.load(network.path, network.device)
    predictor.header.check_model(model.name, model.sha256)
    if network.landmarks is None:
        model = with_own_landmarks(model, predictor.header)
    if "arkit" in formats:
        BlendshapeSolver(model)  # refuses a model without these expressions
    fitter = FrameFitter(predictor, model, config.how, config.faces.refine)
    prepare_output_folder(config.out)
    boxes = config.out / "boxes.csv"
    n_frames, tracks = _detect(config, source, find, boxes)
    remove_earlier_files(config.out)
    faces = _faces(config, tracks, n_frames)
    n_looks = sum(-(-own.n_detected // identity_step(own.n_detected, config.identity_frames)) for own in faces)
    with progress_bar(console, "identity", n_looks) as advance:
        detected = [(own.detected(boxes), own.n_detected) for own in faces]
        identities = find_identities(source, detected, fitter, at_most=config.identity_frames, advance=advance)
    followers = [
        FaceFollower(fitter, own, open_smoother(config.smoothing, source.fps), source.fps) for own in identities
    ]
    try:
        _follow(config, source, faces, followers, fitter, formats)
    finally:  # also when interrupted
        summary = {
            **_job_summary(config, source, fitter, n_frames),
            "faces": [face_summary(*own, config.out) for own in zip(faces, followers, strict=True)],
        }
        write_file(config.out / "track.json", json.dumps(summary, indent=1) + "\n")
    for face, follower in zip(faces, followers, strict=True):
        for line in face_report(face, follower, config.smoothing):
            say(console, line)
    return 0


def _silence_decoders() -> None:
    """Keeps FFmpeg and OpenCV from writing to stderr; errors of videos are reported once, by this command."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)


def _check_call(config: TrackConfig) -> tuple[TrackFormat, ...]:
    """Checks the options before anything takes time, and returns the formats to write.

    Raises:
        UsageError: An option is out of its range, a format is unknown, or a package that it needs is not installed.
    """
    known = get_args(TrackFormat)
    formats = tuple(own.strip() for own in config.write.split(",") if own.strip())
    unknown = [own for own in formats if own not in known]
    if unknown or not formats:
        raise UsageError(f"expected --write of {', '.join(known)}, separated by commas, found {config.write!r}")
    if config.detect_every < 1:
        raise UsageError(f"expected --detect-every of 1 or more, found {config.detect_every}")
    if config.identity_frames < 1:
        raise UsageError(f"expected --identity-frames of 1 or more, found {config.identity_frames}")
    config.how.check()
    if "usdc" in formats:
        usd_module("Usd")
    if config.how.camera == "affine" and {"glb", "usdc"} & set(formats):
        raise UsageError("expected another --camera than affine for --write glb or usdc, which have no such cameras")
    return tuple(own for own in known if own in formats)


def _finder(config: TrackConfig, source: FrameSource) -> Find:
    """Returns a function that finds the boxes in a frame, from a file or by the detector.

    It returns None for frames that the file does not name, since a file may have boxes for every hundredth frame only.

    Raises:
        Pix2FaceError: The file cannot be read, or a package that the detector needs is not installed.
    """
    if config.faces.boxes is None:
        detector = open_detector(config.faces.detector, config.faces.smallest_face)
        return lambda index, image: sure_faces(detector.candidates(image), config.faces.min_score)
    given = read_box_file(config.faces.boxes)
    if source.pictures:
        return lambda index, image: given.of_frame(index) or given.of_image(source.pictures[index]) or None
    return lambda index, image: given.of_frame(index) or None


def _detect(config: TrackConfig, source: FrameSource, find: Find, boxes: Path) -> tuple[int, Sequence[TrackSummary]]:
    """First pass: writes the boxes to a file, and returns the number of frames and the tracks.

    Raises:
        InputFileError: There is no frame, or no face in any.
    """
    with GrowingFile(boxes) as file, progress_bar(console, "detect", source.n_announced) as advance:
        tracker = FaceTracker(file, source.fps)
        n_frames = find_boxes(source, find, tracker, every=config.detect_every, advance=advance)
    if source.is_cut_short(n_frames):
        say(
            console,
            f"warning: {source.path}: {source.n_announced} frames announced, {n_frames} decoded: an edit list hides "
            "the rest, or the file is cut off or damaged; going on with what there is",
        )
    if not tracker.tracks:
        by = f"in {config.faces.boxes}" if config.faces.boxes else f"by the detector {config.faces.detector}"
        raise InputFileError(
            f"{source.path}: expected a face, found none {by} in {counted(n_frames, 'frame')}; "
            "look for smaller faces with --smallest-face (0.02 or less), accept doubtful ones with --min-score 0.5, or "
            "say where the face is with --boxes"
        )
    return n_frames, tracker.tracks


def _faces(config: TrackConfig, tracks: Sequence[TrackSummary], n_frames: int) -> list[ClipFace]:
    least = 0.0 if config.faces.boxes else LEAST_SHARE_DETECTED / config.detect_every
    chosen = [[own] for own in lasting_faces(tracks, least)] if config.all_faces else [main_face(tracks, least)]
    faces = []
    for index, own in enumerate(chosen):
        folder = config.out / f"face-{index}" if config.all_faces else config.out
        prepare_output_folder(folder)
        size_px = sum(part.weight for part in own) / sum(part.n_detected for part in own)
        if size_px < SMALL_FACE_PX:
            say(
                console,
                f"warning: {folder}: the face is {size_px:.0f} px large; below {SMALL_FACE_PX:.0f} little is seen",
            )
        faces.append(
            ClipFace(folder, own, range(own[0].first, own[0].last + 1) if config.all_faces else range(n_frames))
        )
    return faces


def _follow(
    config: TrackConfig,
    source: FrameSource,
    faces: Sequence[ClipFace],
    followers: Sequence[FaceFollower],
    fitter: FrameFitter,
    formats: tuple[TrackFormat, ...],
) -> None:
    """Third pass: fits every frame, and writes it as soon as it is smoothed."""
    every_box = [boxes_of_every_frame(own.detected(config.out / "boxes.csv"), own.frames) for own in faces]
    model = fitter.model
    n_frames = max(own.frames.stop for own in faces)

    def open_files(index: int, image: UInt8[ndarray, "h w 3"]) -> TrackFiles:
        size_px = (image.shape[0], image.shape[1])
        return TrackFiles(faces[index].folder, formats, source.fps, size_px, followers[index].identity, model)

    with ExitStack() as stack:
        # Closed when their face ends, since a long clip may have too many faces for all files to be open.
        files: dict[int, TrackFiles] = {}
        overlay = None
        if "video" in formats:
            overlay = stack.enter_context(OverlayVideo(config.out / OVERLAY_NAME, source.fps))
        advance = stack.enter_context(progress_bar(console, "track", n_frames))
        for frame in follow_faces(source, every_box, followers, fitter):
            for index, own in frame.faces.items():
                if index not in files:
                    files[index] = stack.enter_context(open_files(index, frame.image))
                files[index].write(own, frame.time_s)
                faces[index].counts.update([own.box.source, f"fit {own.state}"])
                if frame.index == faces[index].frames[-1]:
                    files[index].close()
            if overlay is not None:
                overlay.write(draw_frame(frame))
            advance()


def _landmarks_of(config: TrackConfig, fitter: FrameFitter) -> str:
    """Returns where the landmark vertices come from: the path of a file, "checkpoint" or "model"."""
    if config.faces.network.landmarks is not None:
        return str(config.faces.network.landmarks)
    return "checkpoint" if fitter.predictor.header.landmarks else "model"


def _job_summary(config: TrackConfig, source: FrameSource, fitter: FrameFitter, n_frames: int) -> dict[str, object]:
    return {
        "video": str(config.video),
        "fps": source.fps,
        "frames": n_frames,
        "frames_announced": source.n_announced,
        "detector": None if config.faces.boxes else config.faces.detector,
        "min_score": config.faces.min_score,
        "smallest_face": config.faces.smallest_face,
        "smoothing": config.smoothing,
        "camera": config.how.camera,
        "regularisation": config.how.regularisation,
        "silhouette": config.how.is_held,
        "correction": config.how.is_corrected and fitter.predictor.header.n_corrected > 0,
        "landmark_type": "2d" if config.how.landmark_type == "2d" else "3d",
        "landmarks": _landmarks_of(config, fitter),
        "refine": config.faces.refine,
        "detect_every": config.detect_every,
        "model": {"name": fitter.model.name, "sha256": fitter.model.sha256},
        "licence": fitter.predictor.header.licence,
    }
