"""Everything around predictor and fit, with stand-ins for both."""

import math

import numpy as np
import pytest

from pix2face.benchmark_data import BenchmarkFace, BenchmarkItem, find_benchmark
from pix2face.crops import FaceBox
from pix2face.errors import InputFileError, UsageError
from pix2face.evaluation import Evaluator, compare_maps, evaluate_faces, mean_face_in_box
from pix2face.evaluation_report import BASELINE, NETWORK, make_report, report_as_json
from pix2face.face_maps import FaceMaps
from pix2face.manifest import load_manifest
from tests.pix2face.benchmark_files import (
    StubFit,
    StubPredictor,
    fit_that_fails,
    frontal_camera,
    landmarks_of,
    square_maps,
    write_heldout,
)
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
TRUTH = landmarks_of(MODEL, frontal_camera())
TRUE_BOX = FaceBox.around(TRUTH)
IN_CROP = StubPredictor().predict(np.zeros((200, 200, 3), dtype=np.uint8), TRUE_BOX).crop.to_crop(TRUTH)


def face(name: str = "face", group: str = "ibug", **changes) -> BenchmarkFace:
    image = np.zeros((200, 200, 3), dtype=np.uint8)
    return BenchmarkFace(**({"name": name, "group": group, "image": image, "landmarks2d": TRUTH} | changes))


def evaluator(error_px: float = 0.0, fit=None) -> Evaluator:
    return Evaluator(MODEL, StubPredictor(), fit or (lambda maps, centre: StubFit(IN_CROP, error_px)), "box-sqrt")


def item(loaded: BenchmarkFace) -> BenchmarkItem:
    return BenchmarkItem(loaded.name, lambda: loaded)


def test_a_shift_of_three_pixels_is_measured_as_such():
    result = evaluator(3.0).evaluate(face())
    size = math.sqrt(TRUE_BOX.width * TRUE_BOX.height)
    assert result.errors["68"] == pytest.approx(3 / size)
    assert result.errors["51"] == pytest.approx(3 / size)
    np.testing.assert_allclose(result.landmarks2d, TRUTH + np.array([3.0, 0.0]), atol=1e-9)


def test_the_fit_is_told_where_the_image_centre_lies_in_the_crop():
    centres = []

    def fit(maps, image_centre):
        centres.append(image_centre)
        return StubFit(IN_CROP)

    evaluator(fit=fit).evaluate(face())
    crop = StubPredictor().predict(np.zeros((200, 200, 3), dtype=np.uint8), TRUE_BOX).crop
    np.testing.assert_allclose(crop.to_image(centres[0]), [100, 100], atol=1e-9)


def test_the_baseline_of_a_frontal_mean_face_is_exact():
    result = evaluator().evaluate(face())
    assert result.baseline["68"] == pytest.approx(0, abs=1e-9)


def test_the_baseline_has_the_area_and_centre_of_the_box_and_one_scale():
    box = FaceBox(10, 20, 110, 70)
    placed = mean_face_in_box(MODEL, box)
    tight = FaceBox.around(placed)
    assert tight.width * tight.height == pytest.approx(100 * 50)
    np.testing.assert_allclose(tight.centre, box.centre)
    assert tight.width / tight.height == pytest.approx(TRUE_BOX.width / TRUE_BOX.height)


def test_a_model_without_landmarks_is_refused_by_name():
    bare = type(MODEL)(**{**vars(MODEL), "landmarks": {}})
    with pytest.raises(UsageError, match=MODEL.name):
        mean_face_in_box(bare, TRUE_BOX)


@pytest.mark.parametrize("fit", [fit_that_fails, lambda maps, centre: StubFit(np.full((68, 2), np.nan))])
def test_a_failed_fit_stays_in_the_figures(fit):
    failed = evaluator(fit=fit).evaluate(face())
    assert failed.errors == {"68": math.inf, "51": math.inf}
    assert failed.failure
    good = evaluator(1.0).evaluate(face())
    row = make_report(load_manifest("ibug"), {}, [failed, good]).rows[0]
    assert (row.all_images.n_images, row.all_images.n_failed) == (2, 1)
    assert row.all_images.mean == pytest.approx(good.errors["68"])
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
    results, unreadable = evaluate_faces(items, evaluator(), lambda: done.append(1))
    assert [result.name for result in results] == ["a", "d"]
    assert [problem.name for problem in unreadable] == ["b", "c"]
    assert "NaN" in unreadable[0].reason
    assert len(done) == 4


def test_maps_are_compared_where_both_are_face():
    truth, predicted = square_maps(80, 2), square_maps(83, 1)
    predicted.mask[60:80] = False
    errors = compare_maps(predicted, truth)
    assert (errors.pncc_mm, errors.offset_mm, errors.offset_baseline_mm) == pytest.approx((3, 1, 2))
    assert errors.mask_iou == pytest.approx(0.75)


def test_maps_without_a_common_pixel_have_no_error_and_no_overlap():
    empty = FaceMaps(*(np.zeros((200, 200, 3), dtype=np.float32) for _ in range(2)), np.zeros((200, 200), dtype=bool))
    errors = compare_maps(empty, square_maps())
    assert (errors.pncc_mm, errors.mask_iou) == (None, 0)


def test_heldout_faces_measure_maps_in_the_crop(tmp_path):
    write_heldout(tmp_path, MODEL)
    manifest = load_manifest("builtin-heldout")
    found = find_benchmark(manifest, tmp_path, MODEL)
    results, _ = evaluate_faces(
        found.items, Evaluator(MODEL, StubPredictor(85.0), lambda m, c: StubFit(IN_CROP), "box-sqrt")
    )
    report = make_report(manifest, {}, results, found.missing)
    assert report.maps.pncc_mm == pytest.approx(5)
    assert report.maps.offset_mm == pytest.approx(2)
    side = 1.4 * TRUE_BOX.longer_side
    assert report.maps.mask_iou == pytest.approx((80 / side) ** 2, rel=0.05)


def test_mean_of_bins_is_unweighted_and_absent_where_a_bin_is_empty():
    bins = ("|yaw| <= 30°", "30° < |yaw| <= 60°", "|yaw| > 60°")
    shifts = [(bins[0], 1), (bins[0], 1), (bins[1], 2), (bins[2], 6)]
    results = [evaluator(shift).evaluate(face(group=group)) for group, shift in shifts]
    manifest = load_manifest("aflw2000-3d")
    row = make_report(manifest, {}, results).rows[0]
    pixel = 1 / math.sqrt(TRUE_BOX.width * TRUE_BOX.height)
    assert row.mean_of_groups == pytest.approx(3 * pixel)
    assert row.all_images.mean == pytest.approx(2.5 * pixel)
    assert make_report(manifest, {}, results[:3]).rows[0].mean_of_groups is None


def test_every_table_has_both_methods_and_both_point_sets():
    report = make_report(load_manifest("ibug"), {}, [evaluator(2.0).evaluate(face())])
    assert [(row.method, row.points) for row in report.rows] == [
        (NETWORK, "68"),
        (NETWORK, "51"),
        (BASELINE, "68"),
        (BASELINE, "51"),
    ]
    assert report_as_json(report)["faces"][0]["errors"]["68"] == report.rows[0].all_images.mean


def test_worst_cases_start_with_failed_fits():
    results = [
        evaluator(1.0).evaluate(face("a")),
        evaluator(fit=fit_that_fails).evaluate(face("b")),
        evaluator(5.0).evaluate(face("c")),
    ]
    report = make_report(load_manifest("ibug"), {}, results)
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
    np.testing.assert_allclose([result.baseline["68"] for result in results], by_hand)
