"""A first prediction refines the boxes of a detector, and tells faces from what only looks like one."""

import numpy as np
import pytest

from pix2face.detectors.protocol import DetectedFace, overlap
from pix2face.geometry.crops import FaceBox
from pix2face.inference.predictor import FACES_AT_A_TIME, Predictor
from pix2face.photographs.refined_detection import (
    RefinedBox,
    confirm_faces,
    find_faces,
    refine_boxes,
    refined_box,
)
from tests.pix2face.coloured_faces import BlobDetector, camera_at, colour_predictor, draw_faces, true_box
from tests.pix2face.photographs.seen_faces import exact_predictor, photographed_face
from tests.synthetic_models import small_head_model

CAMERAS = (camera_at(45, 55), camera_at(115, 60, yaw_deg=25))


@pytest.fixture(scope="module")
def scene():
    model = small_head_model()
    return model, draw_faces(model, CAMERAS), [true_box(model, camera) for camera in CAMERAS]


def moved(box: FaceBox, share: float, larger: float = 1.0) -> FaceBox:
    """Shifted by a share of its longer side, right and down, and enlarged."""
    x, y = box.centre + share * box.longer_side
    half_width, half_height = larger * box.width / 2, larger * box.height / 2
    return FaceBox(float(x - half_width), float(y - half_height), float(x + half_width), float(y + half_height))


@pytest.mark.parametrize(("share", "larger"), [(0.0, 1.0), (0.12, 1.0), (-0.1, 1.2), (0.05, 0.85)])
def test_a_box_that_is_a_little_off_is_brought_back(scene, share, larger):
    model, image, boxes = scene
    for box in boxes:
        better = refine_boxes([(image, moved(box, share, larger))], colour_predictor(model), model)[0]
        assert overlap(better, box) > 0.9


def test_exact_maps_give_the_box_of_the_landmarks_to_a_fraction_of_a_pixel():
    model = small_head_model()
    face = photographed_face(model)
    predictor = exact_predictor(model, [face.maps()])
    (prediction,) = predictor.predict_many([(face.photograph(), face.box)])
    refined = refined_box(prediction, face.box, model)
    assert refined is not None
    for side in ("left", "top", "right", "bottom"):
        assert getattr(refined.box, side) == pytest.approx(getattr(face.box, side), abs=0.4), side
    np.testing.assert_allclose(refined.box.centre, face.box.centre, atol=0.2)
    assert refined.residual_mm < 0.3


def test_a_box_beside_every_face_stays_as_it_is(scene):
    model, image, _ = scene
    beside = FaceBox(60, 1, 75, 12)
    assert refine_boxes([(image, beside)], colour_predictor(model), model) == [beside]
    noise = np.random.default_rng(0).integers(0, 256, image.shape).astype(np.uint8)
    assert refine_boxes([(noise, beside)], colour_predictor(model), model) == [beside]


def test_many_boxes_at_once_are_refined_like_each_alone(scene):
    model, image, boxes = scene
    predictor = colour_predictor(model)
    wrong = [moved(box, 0.1) for box in boxes]
    together = refine_boxes([(image, box) for box in wrong], predictor, model)
    assert together == [refine_boxes([(image, box)], predictor, model)[0] for box in wrong]
    assert refine_boxes([], predictor, model) == []


def test_doubtful_candidates_come_in_only_where_the_maps_fit_a_face(scene):
    model, image, boxes = scene
    noisy = image.copy()
    noisy[90:, 60:] = np.random.default_rng(0).integers(40, 256, noisy[90:, 60:].shape)
    candidates = [
        DetectedFace(moved(boxes[0], 0.05), 0.5),
        DetectedFace(boxes[1], 2.0),
        DetectedFace(FaceBox(70, 92, 95, 118), 0.6),  # noise
        DetectedFace(FaceBox(60, 1, 70, 11), 3.0),  # nothing at all
    ]
    found = confirm_faces(noisy, candidates, colour_predictor(model), model)
    assert len(found) == 2
    assert all(max(overlap(box, own.box) for own in found) > 0.9 for box in boxes)
    assert {face.score for face in found} == {0.5, 2.0}
    assert found[0].box.longer_side >= found[1].box.longer_side


def test_a_crowd_goes_through_the_network_in_portions(scene):
    model, image, boxes = scene
    sizes = []
    whole = colour_predictor(model)

    def counting(pictures):
        sizes.append(len(pictures))
        return whole._network(pictures)

    predictor = Predictor(counting, whole.header)
    assert len(refine_boxes([(image, boxes[0])] * 20, predictor, model)) == 20
    confirm_faces(image, [DetectedFace(boxes[0], 2.0)] * 20, predictor, model)
    assert sizes == [FACES_AT_A_TIME, 4] * 2


def test_two_detections_of_one_face_become_one(scene):
    model, image, boxes = scene
    candidates = [DetectedFace(moved(boxes[0], 0.1), 1.0), DetectedFace(moved(boxes[0], -0.1), 2.0)]
    assert len(confirm_faces(image, candidates, colour_predictor(model), model)) == 1


def test_find_faces_runs_the_chain(scene):
    model, image, boxes = scene
    found = find_faces(image, BlobDetector(), colour_predictor(model), model)
    assert len(found) == 2
    assert all(max(overlap(box, own.box) for own in found) > 0.9 for box in boxes)
    assert find_faces(np.zeros_like(image), BlobDetector(), colour_predictor(model), model) == []


@pytest.mark.parametrize(
    ("residual_mm", "seen_share", "is_refuted", "is_confirmed"),
    [
        (2.4, 0.9, False, True),
        (3.0, 0.5, False, False),  # behind a mask or a hand: the detector decides
        (4.9, 0.3, True, False),  # a network finds a face in anything, but does not see it
        (4.9, None, False, True),
        (3.4, 0.8, False, True),
        (3.6, 0.8, False, False),  # what it sees fits a face worse than any face does
        (3.0, 0.44, True, False),
        (3.0, 0.46, False, False),
    ],
)
def test_what_is_hardly_seen_is_no_face(
    residual_mm: float, seen_share: float | None, is_refuted: bool, is_confirmed: bool
) -> None:
    refined = RefinedBox(FaceBox(0, 0, 10, 10), residual_mm, 0.8, seen_share)
    assert refined.is_refuted is is_refuted
    assert refined.is_confirmed is is_confirmed


class ScoredDetector:
    """Finds three faces, of which one is sure, one doubtful and one no face at all."""

    def __init__(self, boxes):
        self._faces = [DetectedFace(boxes[0], 1.5), DetectedFace(boxes[1], 0.7), DetectedFace(FaceBox(0, 0, 8, 8), 0.6)]

    def candidates(self, image):
        return self._faces

    def detect(self, image):
        raise AssertionError("scores are wanted")


@pytest.mark.parametrize(("min_score", "found"), [(None, {1.5, 0.7}), (0.65, {1.5, 0.7}), (1.0, {1.5}), (2.0, set())])
def test_a_smallest_score_is_for_all_that_is_kept(scene, min_score, found):
    model, image, boxes = scene
    kept = find_faces(image, ScoredDetector(boxes), colour_predictor(model), model, min_score)
    assert {face.score for face in kept} == found
