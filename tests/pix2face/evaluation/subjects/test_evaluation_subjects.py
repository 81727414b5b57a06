"""Network, file and oracle: what each says of a face, and what becomes of a face that it does not find."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pix2face.detectors.protocol import overlap
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFace, BenchmarkItem
from pix2face.evaluation.evaluator import Evaluator, evaluate_faces
from pix2face.evaluation.subjects.detected_faces import FaceSearch
from pix2face.evaluation.subjects.predictions_file import Predictions
from pix2face.evaluation.subjects.subjects import NetworkSubject, OracleSubject, PredictionsSubject
from pix2face.fitting.fit_options import FitOptions
from pix2face.fitting.jaw_contour import JawContour
from pix2face.geometry.camera import HeadPose, rotation_of_pose
from pix2face.geometry.crops import FaceBox
from tests.cameras import posed_camera
from tests.pix2face.benchmark_files import StubPredictor, frontal_camera, landmarks_of, stub_fit
from tests.pix2face.photographs.seen_faces import SureDetector
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
TRUTH = landmarks_of(MODEL, frontal_camera())
IN_CROP = StubPredictor().predict(FaceBox.around(TRUTH)).crop.to_crop(TRUTH)


def face(name="face", **changes) -> BenchmarkFace:
    facts = {"group": "ibug", "landmarks2d": TRUTH, "read_image": lambda: np.zeros((200, 200, 3), dtype=np.uint8)}
    return BenchmarkFace(name=name, **{**facts, **changes})


def perfect_fit(maps, centre):
    return stub_fit(IN_CROP)


def test_all_faces_of_a_batch_go_through_the_network_at_once():
    class Counting(StubPredictor):
        sizes = []

        def predict_batch(self, faces):
            self.sizes.append(len(faces))
            return super().predict_batch(faces)

    evaluator = Evaluator(MODEL, NetworkSubject(Counting(), perfect_fit), "box-sqrt")
    items = [BenchmarkItem(f"{i}", partial(face, f"{i}")) for i in range(7)]
    done = []
    results, _ = evaluate_faces(items, evaluator, done.append, batch_size=3)
    assert Counting.sizes == done == [3, 3, 1]
    assert [result.name for result in results] == [str(i) for i in range(7)]
    assert max(result.error() for result in results) < 1e-9


def test_output_that_is_not_finite_is_a_face_that_was_not_found():
    class Diverged(StubPredictor):
        def predict_batch(self, faces):
            return [replace(own, n_undefined=5) for own in super().predict_batch(faces)]

    (found,) = NetworkSubject(Diverged(), perfect_fit).find([face()])
    assert found.landmarks2d is None
    assert "finite maps" in found.failure


def test_a_detector_decides_where_the_network_looks_and_its_misses_count():
    true_box = FaceBox.around(TRUTH)
    other = FaceBox(0, 0, 30, 30)
    shifted = FaceBox(true_box.left + 5, true_box.top, true_box.right + 5, true_box.bottom)
    looked_at = []

    class Watching(StubPredictor):
        def predict_batch(self, faces):
            looked_at.extend(box for _, box in faces)
            return super().predict_batch(faces)

    def find(*boxes):
        return NetworkSubject(Watching(), perfect_fit, FaceSearch(SureDetector(boxes)).find).find([face()])[0]

    found = find(other, shifted)
    assert found.failure is None
    assert (found.detection.box, found.detection.score, found.detection.n_false) == (shifted, 1.0, 1)
    assert looked_at == [shifted]
    assert find(other).failure == "the detector found 1 elsewhere"
    assert find().failure == "the detector found no face"
    assert looked_at == [shifted]


def test_a_miss_in_a_batch_leaves_the_others_in_their_places():
    truth = FaceBox.around(TRUTH)
    hit = FaceSearch(SureDetector([truth])).find(face())
    missed = FaceSearch(SureDetector([])).find(face())
    subject = NetworkSubject(StubPredictor(), perfect_fit, lambda own: missed if own.name == "b" else hit)
    found = subject.find([face("a"), face("b"), face("c")])
    assert [own.failure for own in found] == [None, "the detector found no face", None]
    assert [own.detection for own in found] == [hit, missed, hit]
    assert subject.find([face("b")])[0].landmarks2d is None


def test_overlap_is_common_over_covered_area():
    box = FaceBox(0, 0, 10, 10)
    assert overlap(box, FaceBox(5, 0, 15, 10)) == pytest.approx(1 / 3)
    assert overlap(box, FaceBox(20, 0, 30, 10)) == 0
    assert overlap(box, box) == 1
    assert overlap(FaceBox(1, 1, 1, 1), FaceBox(1, 1, 1, 1)) == 0


def test_faces_absent_from_a_file_or_nan_in_it_were_not_found(tmp_path):
    landmarks2d = np.stack([TRUTH, np.full((68, 2), np.nan)])
    file = Predictions(source=tmp_path / "x.npz", names=("a", "b"), landmarks2d=landmarks2d)
    subject = PredictionsSubject(file, {"a": 0, "b": 1})
    results = Evaluator(MODEL, subject, "box-sqrt").evaluate([face("a"), face("b"), face("c")])
    assert [result.error() for result in results] == [pytest.approx(0, abs=1e-9), math.inf, math.inf]
    assert [result.failure for result in results] == [None, "NaN or infinity in x.npz", "absent from x.npz"]


def test_poses_of_a_file_are_compared_with_the_true_ones(tmp_path):
    pose = np.array([[1.0, -170.0, 3.0]])
    file = Predictions(source=tmp_path, names=("a",), landmarks2d=TRUTH[None], pose_deg=pose)
    subject = PredictionsSubject(file, {"a": 0})
    true = face("a", pose=HeadPose(0.0, 170.0, 5.0))
    (result,) = Evaluator(MODEL, subject, "box-sqrt").evaluate([true])
    np.testing.assert_allclose(result.pose_errors_deg.angles, [1, 20, -2])
    found, expected = (rotation_of_pose(own) for own in (HeadPose(1.0, -170.0, 3.0), true.pose))
    turn = Rotation.from_matrix(found @ expected.T).magnitude()
    assert result.pose_errors_deg.rotation == pytest.approx(np.degrees(turn))


def random_face(seed=0, yaw_deg=35.0):
    random = np.random.default_rng(seed)
    identity, expression = random.normal(0, 0.6, MODEL.n_identity), random.normal(0, 0.6, MODEL.n_expression)
    camera = posed_camera(100, 100, pitch_deg=5, yaw_deg=yaw_deg, roll_deg=-8, scale=0.8)
    vertices = MODEL.vertices(identity[None].astype(np.float32), expression[None].astype(np.float32))[0]
    return camera.project(vertices[MODEL.landmarks["ibug68"]]), camera


def test_the_oracle_comes_as_near_to_true_landmarks_as_the_model_can():
    landmarks2d, _ = random_face()
    true = face(landmarks2d=landmarks2d, pose=HeadPose(5.0, 35.0, -8.0))
    (result,) = Evaluator(MODEL, OracleSubject(MODEL), "box-sqrt").evaluate([true])
    assert result.error() < 0.25 * result.error("68", "baseline")
    assert result.error() < 0.02
    np.testing.assert_allclose(result.pose_errors_deg.angles, 0, atol=8)
    assert result.pose_errors_deg.rotation < 12


def test_the_oracle_lets_jaw_points_slide_where_the_outline_was_annotated():
    _, camera = random_face(yaw_deg=45.0)
    jaw = JawContour.of(MODEL)
    coefficients = np.zeros(MODEL.n_identity + MODEL.n_expression)
    landmarks2d = camera.project(MODEL.mean[MODEL.landmarks["ibug68"]])
    chosen = jaw.outermost(camera, coefficients)
    landmarks2d[:17] = camera.project(jaw.mean[chosen])
    true = face(landmarks2d=landmarks2d)
    fixed, sliding = (
        Evaluator(MODEL, OracleSubject(MODEL, FitOptions(landmark_type=landmark_type)), "box-sqrt")
        .evaluate([true])[0]
        .landmark_errors[:17]
        .mean()
        for landmark_type in ("3d", "2d")
    )
    assert sliding < 0.5 * fixed


def test_too_few_true_landmarks_for_the_oracle_are_said():
    broken = np.full((68, 2), np.nan)
    (found,) = OracleSubject(MODEL).find([face(landmarks2d=broken)])
    assert found.landmarks2d is None
    assert "landmarks" in found.failure
