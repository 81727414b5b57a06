"""The whole chain over drawn clips: landmarks in every frame, near the true ones, with few frames in memory."""

import io
import weakref
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from pix2face.files.images import encode_image
from pix2face.fitting.face_fit import face_of_coefficients
from pix2face.fitting.least_squares.linear_system import JointAccumulator
from pix2face.fitting.picture_measurement import measure_picture
from pix2face.geometry.crops import FaceBox, crop_camera, square_crop
from pix2face.geometry.maps import FaceMaps
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.rasterise import render_maps
from pix2face.tracking import video
from pix2face.tracking.ahead import FACES_AT_A_TIME
from pix2face.tracking.clip_fit import FrameFitter, SettledFace, box_to_box, expression_of, eye_distance_px
from pix2face.tracking.clip_identity import ClipIdentity, find_identities
from pix2face.tracking.face_follower import FaceFollower, TrackedFrame, find_boxes, follow_faces
from pix2face.tracking.face_tracks import FaceTracker, FrameBox, boxes_of_every_frame, main_face, read_boxes
from pix2face.tracking.smoothing import SPLINE_REACH, open_smoother
from pix2face.tracking.track_summary import ClipFace, face_report, face_summary
from pix2face.tracking.video import FrameSource, open_frames
from tests.fits import paper_fit
from tests.pix2face.coloured_faces import BlobDetector, camera_at, colour_predictor, draw_faces, true_landmarks
from tests.synthetic_models import small_head_model

N_FRAMES = 20


@dataclass(frozen=True, eq=False)
class Clip:
    """A mean face that moves and turns, and the truth of it."""

    model: MorphableModel
    source: FrameSource
    landmarks: np.ndarray


@pytest.fixture(scope="module")
def clip(tmp_path_factory) -> Clip:
    folder, model = tmp_path_factory.mktemp("clip"), small_head_model()
    cameras = [camera_at(55 + 2 * index, 60, yaw_deg=2.0 * index - 20) for index in range(N_FRAMES)]
    for index, camera in enumerate(cameras):
        (folder / f"{index:03d}.png").write_bytes(encode_image(draw_faces(model, [camera])))
    return Clip(model, open_frames(folder), np.stack([true_landmarks(model, camera) for camera in cameras]))


def run(
    clip: Clip,
    out: Path,
    missing: tuple[int, ...] = (),
    smoothing: str = "none",
    refine: bool = True,
    keep: bool = True,
    forget: bool = False,
) -> tuple[Iterable[TrackedFrame], FaceFollower]:
    fitter = FrameFitter(colour_predictor(clip.model), clip.model, refine=refine)
    detector = BlobDetector()
    path = out / "boxes.csv"
    with path.open("w") as file:
        tracker = FaceTracker(file, clip.source.fps)
        n_frames = find_boxes(
            clip.source, lambda index, image: [] if index in missing else detector.detect(image), tracker
        )
    tracks = main_face(tracker.tracks)
    numbers = [own.track for own in tracks]
    detected = [(read_boxes(path, numbers), sum(own.n_detected for own in tracks))]
    (found,) = find_identities(clip.source, detected, fitter, at_most=5)
    if forget:
        found.fits.clear()
    follower = FaceFollower(fitter, found, open_smoother(smoothing, clip.source.fps))
    boxes = boxes_of_every_frame(read_boxes(path, numbers), range(n_frames))
    frames = follow_faces(clip.source, [boxes], [follower], fitter)
    return list(frames) if keep else frames, follower


def unknown(model: MorphableModel) -> ClipIdentity:
    """The mean face, with no fit known yet."""
    return ClipIdentity(np.zeros(model.n_identity), {})


def settled(fitter: FrameFitter, image: np.ndarray, box: FaceBox) -> SettledFace:
    ((_, (seen,)),) = fitter.measure_each([(None, [(image, box)])])
    assert seen is not None
    return fitter.settled(seen, np.zeros(fitter.model.n_identity))


def errors_in_percent(frames: list[TrackedFrame], clip: Clip) -> np.ndarray:
    """Mean landmark error of each frame, % of the eye distance."""
    return np.array(
        [
            100 * np.linalg.norm(frame.faces[0].landmarks2d - truth, axis=1).mean() / frame.faces[0].eye_px
            for frame, truth in zip(frames, clip.landmarks, strict=True)
        ]
    )


@pytest.fixture(scope="module")
def smoothed(clip, tmp_path_factory) -> Callable[[str], tuple[list[TrackedFrame], FaceFollower]]:
    """The tracked clip by the kind of smoothing; each kind is run once."""
    return cache(lambda kind: run(clip, tmp_path_factory.mktemp(kind), smoothing=kind))


@pytest.mark.parametrize("smoothing", ["none", "mean3", "spline"])
def test_every_frame_has_landmarks_near_the_true_ones(clip, smoothed, smoothing):
    frames, _ = smoothed(smoothing)
    assert [frame.index for frame in frames] == list(range(N_FRAMES))
    assert all(set(frame.faces) == {0} for frame in frames)
    assert errors_in_percent(frames, clip).max() < 0.5
    assert all(frame.faces[0].is_fitted for frame in frames)


def test_frames_without_a_detection_are_filled_and_say_so(clip, tmp_path):
    frames, _ = run(clip, tmp_path, missing=(0, 1, 7, 8, 9, 19))
    assert "".join(frame.faces[0].box.source[0] for frame in frames) == "hh" + "d" * 5 + "iii" + "d" * 9 + "h"
    assert errors_in_percent(frames, clip).max() < 0.5


def test_frames_that_the_identity_comes_from_are_not_measured_again(clip, tmp_path, monkeypatch):
    seen = []
    original = FrameFitter._measured

    def measured(self, prediction, image):
        seen.append(prediction.box)
        return original(self, prediction, image)

    monkeypatch.setattr(FrameFitter, "_measured", measured)
    frames, follower = run(clip, tmp_path)
    assert not follower.known_fits  # each is forgotten when its frame is done
    assert len(seen) == len(set(seen)) == N_FRAMES
    every, _ = run(clip, tmp_path, forget=True)
    assert len(seen) == 2 * N_FRAMES + 5
    for known, measured_again in zip(frames, every, strict=True):
        np.testing.assert_allclose(known.faces[0].landmarks2d, measured_again.faces[0].landmarks2d, atol=1e-3)


def test_smoothing_takes_jitter_away_and_reports_it(smoothed):
    (_, raw), (_, smooth) = smoothed("none"), smoothed("mean3")
    assert raw.jitter_raw.share == pytest.approx(raw.jitter_smoothed.share)
    assert smooth.jitter_raw.share == pytest.approx(raw.jitter_raw.share)
    assert smooth.jitter_smoothed.share < 0.7 * smooth.jitter_raw.share


def test_boxes_of_the_detector_alone_will_do_where_the_network_sees_well(clip, tmp_path):
    assert errors_in_percent(run(clip, tmp_path, refine=False)[0], clip).max() < 0.5


def test_a_fit_is_carried_for_half_a_second_and_none_is_invented(clip):
    fitter = FrameFitter(colour_predictor(clip.model), clip.model)
    follower = FaceFollower(fitter, unknown(clip.model), open_smoother("mean3", 25), 25)
    image, box = next(clip.source.frames()), next(_detections(clip))
    seen = settled(fitter, image, box.box)
    blank = [False, False, True, True, *[False] * 20, True]
    done = []
    for index, is_seen in enumerate(blank):
        own = FrameBox(index, box.box, "detected" if is_seen else "held", 0)
        done += follower.push(own, seen if is_seen else None)
    done += follower.flush()
    assert [face.box.frame for face in done] == list(range(len(blank)))
    states = ["none"] * 2 + ["fitted"] * 2 + ["carried"] * 13 + ["none"] * 7 + ["fitted"]
    assert [face.state for face in done] == states


def test_where_neither_detector_nor_network_finds_a_face_there_is_no_fit(clip):
    fitter = FrameFitter(colour_predictor(clip.model), clip.model)
    image, box = next(clip.source.frames()), next(_detections(clip))
    seen = settled(fitter, image, box.box)
    for source, share, state in (("held", 0.2, "none"), ("held", 0.8, "fitted"), ("detected", 0.2, "fitted")):
        follower = FaceFollower(fitter, unknown(clip.model), open_smoother("none", 25))
        (face,) = follower.push(replace(box, source=source), replace(seen, seen_share=share))
        assert (face.state, face.seen_share) == (state, share)


def test_maps_without_a_face_carry_the_last_fit_along_with_the_box(clip):
    fitter = FrameFitter(colour_predictor(clip.model), clip.model)
    boxes = list(boxes_of_every_frame(_detections(clip), range(N_FRAMES)))
    follower = FaceFollower(fitter, unknown(clip.model), open_smoother("none", 25))
    image = next(clip.source.frames())
    (first,) = follower.push(boxes[0], settled(fitter, image, boxes[0].box))
    (second,) = follower.push(boxes[3], None)
    assert first.is_fitted
    assert not second.is_fitted
    moved = (first.landmarks2d - boxes[0].box.centre) * boxes[3].box.longer_side / boxes[0].box.longer_side
    np.testing.assert_allclose(second.landmarks2d, moved + boxes[3].box.centre, atol=1e-9)


def test_a_clip_whose_maps_never_hold_a_face_has_the_mean_face_in_its_boxes(clip):
    fitter = FrameFitter(colour_predictor(clip.model), clip.model)
    nothing = (np.zeros((50, 50, 3), np.uint8), FaceBox(10, 10, 30, 30))
    assert list(fitter.measure_each([(None, [nothing])])) == [(None, [None])]
    follower = FaceFollower(fitter, unknown(clip.model), open_smoother("none", 25))
    box = next(iter(_detections(clip)))
    (face,) = follower.push(box, None)
    around = FaceBox.around(face.landmarks2d)
    np.testing.assert_allclose(around.centre, box.box.centre, atol=1e-6)
    assert around.longer_side == pytest.approx(box.box.longer_side)


def _detections(clip: Clip):
    file = io.StringIO()
    tracker, detector = FaceTracker(file, 25), BlobDetector()
    find_boxes(clip.source, lambda index, image: detector.detect(image), tracker)
    for line in file.getvalue().splitlines()[1:]:
        frame, track, *sides, _ = line.split(",")
        yield FrameBox(int(frame), FaceBox(*map(float, sides)), "detected", int(track))


def test_few_frames_are_in_memory_at_a_time(clip, tmp_path, monkeypatch):
    alive, most = weakref.WeakSet(), 0
    original = video.read_photograph

    class Frame(np.ndarray):
        """An array that can be in a set."""

        __hash__ = object.__hash__

        def __eq__(self, other: object) -> bool:
            return self is other

    def read(path: Path) -> np.ndarray:
        nonlocal most
        frame = original(path).view(Frame)
        alive.add(frame)
        most = max(most, len(alive))
        return frame

    monkeypatch.setattr(video, "read_photograph", read)
    longer = replace(clip.source, n_announced=60, pictures=clip.source.pictures * 3)
    n_done = 0
    for _ in run(Clip(clip.model, longer, clip.landmarks), tmp_path, smoothing="spline", keep=False)[0]:
        n_done += 1
    assert n_done == 60
    # Five chunks: being refined, measured and written, and one between each two; frames decoded ahead, and those that
    # the smoother waits for.
    assert most <= 5 * FACES_AT_A_TIME + video.FRAMES_DECODED_AHEAD + SPLINE_REACH + 2


def test_two_faces_stay_apart(tmp_path):
    model = small_head_model()
    cameras = [(camera_at(40, 45 + index), camera_at(120, 75 - index)) for index in range(12)]
    for index, own in enumerate(cameras):
        (tmp_path / f"{index:03d}.png").write_bytes(encode_image(draw_faces(model, own)))
    source = open_frames(tmp_path)
    fitter, detector = FrameFitter(colour_predictor(model), model), BlobDetector()
    with (tmp_path / "boxes.csv").open("w") as file:
        tracker = FaceTracker(file, source.fps)
        find_boxes(source, lambda index, image: detector.detect(image), tracker, every=2)
    assert len(tracker.tracks) == 2
    spans = [range(12), range(2, 9)]
    boxes = [
        boxes_of_every_frame(read_boxes(tmp_path / "boxes.csv", [own]), span)
        for own, span in zip((0, 1), spans, strict=True)
    ]
    followers = [FaceFollower(fitter, unknown(model), open_smoother(own, 25)) for own in ("spline", "mean3")]
    frames = list(follow_faces(source, boxes, followers, fitter))
    assert [sorted(frame.faces) for frame in frames] == [[0, 1] if 2 <= index < 9 else [0] for index in range(12)]
    middles = {own: np.mean([frame.faces[own].landmarks2d[:, 0].mean() for frame in frames[2:9]]) for own in (0, 1)}
    assert sorted(round(middle / 10) for middle in middles.values()) == [4, 12]


def test_a_change_of_track_is_not_smoothed_across(clip):
    fitter = FrameFitter(colour_predictor(clip.model), clip.model)
    follower = FaceFollower(fitter, unknown(clip.model), open_smoother("mean3", 25))
    done = []
    for index, own in enumerate(_detections(clip)):
        far = index >= 10
        box = type(own)(own.frame, FaceBox(500, 500, 540, 540) if far else own.box, own.source, int(far))
        done += follower.push(box, None)
    done += follower.flush()
    assert len(done) == N_FRAMES
    assert max(face.landmarks2d.max() for face in done[:10]) < 200
    assert min(face.landmarks2d.min() for face in done[10:]) > 400


def test_the_identity_of_a_clip_is_that_of_all_frames_together_and_expressions_follow_it():
    model, rng = small_head_model(), np.random.default_rng(0)
    identity = rng.normal(size=model.n_identity)
    joint, measured, truth = JointAccumulator(model.n_identity), [], []
    for index in range(4):
        expression = rng.normal(size=model.n_expression)
        camera = camera_at(60, 60, yaw_deg=10.0 * index - 15)
        vertices = model.vertices(identity[None], expression[None])[0]
        crop = square_crop(FaceBox.around(camera.project(vertices[model.landmarks["ibug68"]])), 1.4, 128)
        rendered = render_maps(model, vertices, crop_camera(camera, crop), 128, 128)
        maps = FaceMaps(rendered["pncc"], rendered["offset"], rendered["mask"])
        own = measure_picture(
            maps, model, paper_fit(camera="weak-perspective", regularisation=1e-3), principal_point_px=None
        )
        joint.add(own.system, own.regularisation)
        measured.append(own)
        truth.append(expression)
    shared, expressions = joint.solve()
    assert np.abs(shared - identity).max() < 0.1
    for own, expression, eliminated in zip(measured, truth, expressions, strict=True):
        np.testing.assert_allclose(expression_of(own, shared), eliminated, atol=1e-6)
        assert np.abs(expression_of(own, shared) - expression).max() < 0.2


def test_the_eye_distance_does_not_shrink_as_the_head_turns():
    model = small_head_model()
    zero = (np.zeros(model.n_identity), np.zeros(model.n_expression))
    frontal, turned = (face_of_coefficients(model, camera_at(50, 50, yaw_deg=yaw), *zero) for yaw in (0.0, 60.0))
    assert eye_distance_px(turned) == pytest.approx(eye_distance_px(frontal))
    corners = frontal.landmarks2d[[36, 45]]
    assert eye_distance_px(frontal) == pytest.approx(np.linalg.norm(corners[0] - corners[1]), rel=0.02)
    larger = frontal.transformed(box_to_box(FaceBox(0, 0, 10, 10), FaceBox(5, 5, 25, 25)))
    assert eye_distance_px(larger) == pytest.approx(2 * eye_distance_px(frontal))


@pytest.mark.parametrize("share", [None, 0.2, 0.9])
def test_a_face_of_which_little_is_seen_is_told(clip, smoothed, tmp_path, monkeypatch, share):
    original = FrameFitter._measured

    def measured(self, *arguments):
        found = original(self, *arguments)
        return replace(found, view=replace(found.view, seen_share=share))

    if share is None:  # this network has no plane for it
        _, follower = smoothed("none")
    else:
        monkeypatch.setattr(FrameFitter, "_measured", measured)
        _, follower = run(clip, tmp_path)
    assert follower.seen_share == share
    face = ClipFace(tmp_path / "face-3", [], range(N_FRAMES))
    assert face_summary(face, follower, tmp_path)["seen_share"] == share
    warned = [line for line in face_report(face, follower, "none") if line.startswith("warning")]
    assert len(warned) == (share == 0.2)
    assert all("face-3: the network sees 20 % of a face there" in line for line in warned)
