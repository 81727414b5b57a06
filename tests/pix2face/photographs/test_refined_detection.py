"""A first prediction refines the boxes of a detector, and tells faces from what only looks like one."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from pix2face.detectors.protocol import DetectedFace, overlap
from pix2face.geometry.crops import INFERENCE_SCALE, FaceBox, square_crop
from pix2face.inference.answers import Answers
from pix2face.inference.predictor import FACES_AT_A_TIME, Predictor
from pix2face.networks import MAP_PLANES
from pix2face.photographs.refined_detection import RefinedBox, refine_boxes, refine_faces, refined_boxes
from tests.pix2face.coloured_faces import camera_at, colour_predictor, draw_faces, true_box
from tests.pix2face.photographs.seen_faces import exact_predictor, header_of, photographed_face
from tests.pix2face.stub_networks import predictor_of
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
    (refined,) = refined_boxes([(face.photograph(), face.box)], predictor, model)
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


@dataclass(frozen=True)
class LandmarkNetwork:
    """Predicts the same landmarks in every crop, and maps without a face, or other landmarks with such maps."""

    numbers: np.ndarray
    numbers_with_maps: np.ndarray

    def answers(self, pictures):
        maps = np.zeros((*pictures.shape[:3], MAP_PLANES), dtype=np.float32)
        return Answers(maps, np.repeat(self.numbers_with_maps[None], len(pictures), axis=0))

    def landmarks(self, pictures):
        return np.repeat(self.numbers[None], len(pictures), axis=0)


def landmark_predictor(model, points2d: np.ndarray, scale: float, scale_with_maps: float | None = None) -> Predictor:
    """Predicts points of crops, in units of their side from their middle, with one scale of their errors.

    The scale may be another where maps are predicted as well.
    """
    alone, with_maps = (
        np.column_stack([points2d, np.full(len(points2d), np.log(own))]).astype(np.float32)
        for own in (scale, scale_with_maps or scale)
    )
    return Predictor(LandmarkNetwork(alone, with_maps), replace(header_of(model), n_landmarks=len(points2d)))


@pytest.mark.parametrize(("scale", "is_plausible"), [(1 / 128, True), (6 / 128, False)])
def test_landmarks_of_the_network_and_their_expected_errors_decide_where_it_predicts_them(scale, is_plausible):
    model = small_head_model()
    face = photographed_face(model)
    shift_px = 3.0
    crop = square_crop(face.box, INFERENCE_SCALE, 128)
    points2d = crop.to_crop(face.landmarks2d + shift_px) / 128 - 0.5
    predictor = landmark_predictor(model, points2d, scale)
    (refined,) = refined_boxes([(face.photograph(), face.box)], predictor, model)
    assert refined is not None
    assert refined.box.left == pytest.approx(face.box.left + shift_px, abs=1e-3)
    assert refined.is_plausible == is_plausible
    assert refined.is_refuted != is_plausible
    assert refined.residual_mm is None


@pytest.mark.parametrize(("scale", "is_plausible"), [(1 / 128, True), (3 / 128, False)])
def test_a_box_of_a_turned_picture_keeps_its_turn_where_the_network_is_surer(scale, is_plausible):
    """Of upright boxes, both expected errors are plausible."""
    model = small_head_model()
    face = photographed_face(model)
    turned = replace(face.box, turn_deg=90.0)
    points2d = square_crop(turned, INFERENCE_SCALE, 128).to_crop(face.landmarks2d) / 128 - 0.5
    (refined,) = refined_boxes([(face.photograph(), turned)], landmark_predictor(model, points2d, scale), model)
    assert refined is not None
    assert refined.is_plausible
    assert refined.box.turn_deg == (90 if is_plausible else 0)  # else a second look does not go by the turn
    np.testing.assert_allclose(refined.box.centre, face.box.centre, atol=1e-3 if is_plausible else 8)


def test_a_doubtful_face_is_looked_at_again_with_its_maps_which_turn_it_upright():
    model = small_head_model()
    face = photographed_face(model)
    points2d = square_crop(face.box, INFERENCE_SCALE, 128).to_crop(face.landmarks2d) / 128 - 0.5
    doubtful, again = 6 / 128, 1 / 128
    (refined,) = refined_boxes(
        [(face.photograph(), face.box)], landmark_predictor(model, points2d, doubtful, again), model
    )
    assert refined is not None
    assert refined.is_plausible


def test_a_network_whose_landmarks_are_not_finite_finds_no_face():
    model = small_head_model()
    face = photographed_face(model)
    predictor = landmark_predictor(model, np.full((68, 2), np.nan), 0.01)
    assert refined_boxes([(face.photograph(), face.box)], predictor, model) == [None]
    assert refine_faces(face.photograph(), [DetectedFace(face.box, 2.0)], predictor, model) == []


def test_many_boxes_at_once_are_refined_like_each_alone(scene):
    model, image, boxes = scene
    predictor = colour_predictor(model)
    wrong = [moved(box, 0.1) for box in boxes]
    together = refine_boxes([(image, box) for box in wrong], predictor, model)
    assert together == [refine_boxes([(image, box)], predictor, model)[0] for box in wrong]
    assert refine_boxes([], predictor, model) == []


def test_a_network_that_tells_what_it_sees_rejects_what_fits_no_face(scene):
    model, _, boxes = scene
    noisy = draw_faces(model, CAMERAS, (200, 160))
    noisy[160:, 60:] = np.random.default_rng(0).integers(40, 256, noisy[160:, 60:].shape)
    faces = [
        DetectedFace(moved(boxes[0], 0.05), 0.5),
        DetectedFace(boxes[1], 2.0),
        DetectedFace(FaceBox(70, 162, 95, 188), 0.6),  # noise
        DetectedFace(FaceBox(60, 1, 70, 11), 3.0),  # nothing at all
    ]
    found = refine_faces(noisy, faces, colour_predictor(model, says_seen=True), model)
    assert {face.score for face in found} == {2.0, 0.5}
    assert found[0].box.longer_side >= found[1].box.longer_side
    assert all(max(overlap(box, own.box) for own in found) > 0.9 for box in boxes)
    by_another = refine_faces(noisy, faces, colour_predictor(model), model)
    assert {face.score for face in by_another} == {2.0, 0.5, 0.6}


def test_a_crowd_goes_through_the_network_in_portions(scene):
    model, image, boxes = scene
    sizes = []
    whole = colour_predictor(model)

    def counting(pictures):
        sizes.append(len(pictures))
        return whole._network.network(pictures)

    predictor = predictor_of(counting, whole.header)
    assert len(refine_boxes([(image, boxes[0])] * 20, predictor, model)) == 20
    refine_faces(image, [DetectedFace(boxes[0], 2.0)] * 20, predictor, model)
    assert sizes == [FACES_AT_A_TIME, 4] * 2


def test_of_two_detections_of_a_face_the_surer_stays(scene):
    model, image, boxes = scene
    faces = [DetectedFace(moved(boxes[0], 0.2), 1.5), DetectedFace(moved(boxes[0], -0.2), 2.0)]
    (found,) = refine_faces(image, faces, colour_predictor(model), model)
    assert found.score == 2.0
    assert overlap(found.box, boxes[0]) > 0.9
    assert refine_faces(image, [], colour_predictor(model), model) == []


@pytest.mark.parametrize(
    ("residual_mm", "overlap_before", "can_refute", "is_plausible", "is_refuted"),
    [
        (2.4, 0.8, True, True, False),
        (2.4, 0.3, True, False, True),  # a face, but beside the box
        (6.5, 0.8, True, False, True),
        (6.5, 0.8, False, False, False),  # a network that was not trained for photographs: the detector decides
        (2.4, 0.8, False, True, False),
    ],
)
def test_limits(
    residual_mm: float, overlap_before: float, can_refute: bool, is_plausible: bool, is_refuted: bool
) -> None:
    refined = RefinedBox(FaceBox(0, 0, 10, 10), overlap_before, residual_mm=residual_mm, can_refute=can_refute)
    assert refined.is_plausible is is_plausible
    assert refined.is_refuted is is_refuted
