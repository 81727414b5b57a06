"""Everything around predictor and fit, with stand-ins for both."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pix2face.errors import InputFileError, UsageError
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFace, BenchmarkItem
from pix2face.evaluation.benchmarks.benchmark_search import find_benchmark
from pix2face.evaluation.benchmarks.manifest import load_manifest
from pix2face.evaluation.evaluator import BASELINE, Evaluator, evaluate_faces, mean_face_in_box
from pix2face.evaluation.report.evaluation_report import EvaluationSettings, make_report
from pix2face.evaluation.report.report_files import report_as_json
from pix2face.evaluation.subjects.subjects import NetworkSubject
from pix2face.evaluation.subjects.truth_errors import errors_of_maps
from pix2face.geometry.crops import FaceBox
from pix2face.geometry.maps import FaceMaps
from tests.pix2face.benchmark_files import (
    StubPredictor,
    fit_that_fails,
    frontal_camera,
    landmarks_of,
    square_maps,
    stub_fit,
    write_heldout,
)
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
TRUTH = landmarks_of(MODEL, frontal_camera())
TRUE_BOX = FaceBox.around(TRUTH)
IN_CROP = StubPredictor().predict(TRUE_BOX).crop.to_crop(TRUTH)


SETTINGS = EvaluationSettings(method="network")


def black() -> np.ndarray:
    return np.zeros((200, 200, 3), dtype=np.uint8)


def face(name: str = "face", group: str = "ibug", **changes) -> BenchmarkFace:
    return BenchmarkFace(**({"name": name, "group": group, "read_image": black, "landmarks2d": TRUTH} | changes))


def evaluator(error_px: float = 0.0, fit=None, predictor=None) -> Evaluator:
    found = StubPredictor().predict(TRUE_BOX).crop.to_crop(TRUTH + [error_px, 0])
    subject = NetworkSubject(predictor or StubPredictor(), fit or (lambda maps, centre: stub_fit(found)))
    return Evaluator(MODEL, subject, "box-sqrt")


def evaluated(loaded: BenchmarkFace, error_px: float = 0.0, fit=None):
    return evaluator(error_px, fit).evaluate([loaded])[0]


def item(loaded: BenchmarkFace) -> BenchmarkItem:
    return BenchmarkItem(loaded.name, lambda: loaded)


def test_a_shift_of_three_pixels_is_measured_as_such():
    result = evaluated(face(), 3.0)
    size = math.sqrt(TRUE_BOX.width * TRUE_BOX.height)
    assert result.error("68") == pytest.approx(3 / size)
    assert result.error("51") == pytest.approx(3 / size)
    np.testing.assert_allclose(result.landmarks2d, TRUTH + np.array([3.0, 0.0]), atol=1e-9)


def test_the_fit_is_told_where_the_image_centre_lies_in_the_crop():
    centres = []

    def fit(maps, image_centre):
        centres.append(image_centre)
        return stub_fit(IN_CROP)

    evaluated(face(), fit=fit)
    crop = StubPredictor().predict(TRUE_BOX).crop
    np.testing.assert_allclose(crop.to_image(centres[0]), [100, 100], atol=1e-9)


def test_the_baseline_of_a_frontal_mean_face_is_exact():
    result = evaluated(face())
    assert result.error("68", BASELINE) == pytest.approx(0, abs=1e-9)


def test_the_baseline_has_the_area_and_centre_of_the_box_and_one_scale():
    box = FaceBox(10, 20, 110, 70)
    placed = mean_face_in_box(MODEL, box)
    tight = FaceBox.around(placed)
    assert tight.width * tight.height == pytest.approx(100 * 50)
    np.testing.assert_allclose(tight.centre, box.centre)
    assert tight.width / tight.height == pytest.approx(TRUE_BOX.width / TRUE_BOX.height)


def test_a_model_without_landmarks_is_refused_by_name():
    bare = replace(MODEL, landmarks={})
    with pytest.raises(UsageError, match=MODEL.name):
        mean_face_in_box(bare, TRUE_BOX)


@pytest.mark.parametrize("fit", [fit_that_fails, lambda maps, centre: stub_fit(np.full((68, 2), np.nan))])
def test_a_failed_fit_stays_in_the_figures(fit):
    failed = evaluated(face(), fit=fit)
    assert (failed.error("68"), failed.error("51")) == (math.inf, math.inf)
    assert failed.failure
    good = evaluated(face(), 1.0)
    row = make_report(load_manifest("ibug"), SETTINGS, {}, [failed, good]).rows[0]
    assert (row.all_images.n_images, row.all_images.n_failed) == (2, 1)
    assert row.all_images.mean == pytest.approx(good.error("68"))
    assert row.all_images.failure_rate == 0.5


def test_one_damaged_face_is_listed_and_the_others_are_evaluated():
    def damaged():
        raise InputFileError("b.mat: expected finite numbers, found NaN")

    done = []
    items = [
        item(face("a")),
        BenchmarkItem("b", damaged),
        item(face("c", landmarks2d=np.ones((68, 2)))),
        item(face("d")),
    ]
    results, unreadable = evaluate_faces(items, evaluator(), done.append)
    assert [result.name for result in results] == ["a", "d"]
    assert [problem.name for problem in unreadable] == ["b", "c"]
    assert "NaN" in unreadable[0].reason
    assert done == [1, 1, 1, 1]


def test_maps_are_compared_where_both_are_face():
    truth, predicted = square_maps(80, 2), square_maps(83, 1)
    predicted.mask[60:80] = False
    errors = errors_of_maps(predicted, truth)
    assert (errors.pncc_mm, errors.offset_mm, errors.offset_baseline_mm) == pytest.approx((3, 1, 2))
    assert errors.mask_iou == pytest.approx(0.75)


def test_maps_without_a_common_pixel_have_no_error_and_no_overlap():
    empty = FaceMaps(*(np.zeros((200, 200, 3), dtype=np.float32) for _ in range(2)), np.zeros((200, 200), dtype=bool))
    errors = errors_of_maps(empty, square_maps())
    assert (errors.pncc_mm, errors.mask_iou) == (None, 0)


def test_heldout_faces_measure_maps_in_the_crop(tmp_path):
    write_heldout(tmp_path, MODEL)
    manifest = load_manifest("builtin-heldout")
    found = find_benchmark(manifest, tmp_path, MODEL)
    results, _ = evaluate_faces(found.items, evaluator(predictor=StubPredictor(85.0)))
    report = make_report(manifest, SETTINGS, {}, results, found.missing)
    assert report.maps.pncc_mm == pytest.approx(5)
    assert report.maps.offset_mm == pytest.approx(2)
    side = 1.4 * TRUE_BOX.longer_side
    assert report.maps.mask_iou == pytest.approx((80 / side) ** 2, rel=0.05)


def test_mean_of_bins_is_unweighted_and_absent_where_a_bin_is_empty():
    bins = ("|yaw| <= 30°", "30° < |yaw| <= 60°", "|yaw| > 60°")
    shifts = [(bins[0], 1), (bins[0], 1), (bins[1], 2), (bins[2], 6)]
    results = [evaluated(face(group=group), shift) for group, shift in shifts]
    manifest = load_manifest("aflw2000-3d")
    row = make_report(manifest, SETTINGS, {}, results).rows[0]
    pixel = 1 / math.sqrt(TRUE_BOX.width * TRUE_BOX.height)
    assert row.mean_of_groups == pytest.approx(3 * pixel)
    assert row.all_images.mean == pytest.approx(2.5 * pixel)
    assert make_report(manifest, SETTINGS, {}, results[:3]).rows[0].mean_of_groups is None


def test_every_table_has_both_methods_and_both_point_sets():
    report = make_report(load_manifest("ibug"), SETTINGS, {}, [evaluated(face(), 2.0)])
    assert [(row.method, row.points) for row in report.rows] == [
        ("network", "68"),
        ("network", "51"),
        (BASELINE, "68"),
        (BASELINE, "51"),
    ]
    assert report_as_json(report)["faces"][0]["errors"]["68"] == report.rows[0].all_images.mean


def test_worst_cases_start_with_failed_fits():
    results = [
        evaluated(face("a"), 1.0),
        evaluated(face("b"), fit=fit_that_fails),
        evaluated(face("c"), 5.0),
    ]
    report = make_report(load_manifest("ibug"), SETTINGS, {}, results)
    assert [result.name for result in report.worst(2)] == ["b", "c"]


def test_baseline_on_the_photographs_computed_independently(shared_dir):
    manifest = load_manifest("aflw2000-3d")
    items = find_benchmark(manifest, shared_dir / "data" / "aflw2000_3d" / "dev", MODEL).items[::10]
    results, _ = evaluate_faces(items, evaluator())
    mean = MODEL.mean[MODEL.landmarks["ibug68"]].astype(float)
    by_hand = []
    for true in (loaded.load().landmarks2d for loaded in items):
        points = np.column_stack([mean[:, 0], -mean[:, 1]])
        points /= np.sqrt(np.prod(points.max(0) - points.min(0)))
        size = np.sqrt(np.prod(true.max(0) - true.min(0)))
        points = points * size
        points += (true.max(0) + true.min(0)) / 2 - (points.max(0) + points.min(0)) / 2
        by_hand.append(np.sqrt(((points - true) ** 2).sum(1)).mean() / size)
    np.testing.assert_allclose([result.error("68", BASELINE) for result in results], by_hand)
