"""``evaluate`` without a network: another system's landmarks, the model as an oracle, and what is wrong with files."""

import numpy as np
import pytest

from tests.pix2face.benchmark_files import write_mat, write_photograph, write_pts
from tests.pix2face.evaluation_calls import LANDMARKS, MODEL, measure, predictions_for, run, stored_report, write_ibug

pytestmark = pytest.mark.usefixtures("curves_are_not_drawn")


def test_landmarks_of_another_system_are_measured_and_absent_faces_are_named(tmp_path, small_model, capsys):
    write_ibug(tmp_path, ("image_003_1", "image_004_1", "image_005_1"))
    broken = np.stack([LANDMARKS - 0.5 + [3, 4], np.full((68, 2), np.nan)])
    np.savez(tmp_path / "p.npz", names=["image_003_1", "ibug/image_004_1.jpg"], landmarks=broken)
    assert measure(tmp_path, "--predictions", tmp_path / "p.npz") == 0
    report, printed = stored_report(tmp_path), capsys.readouterr().out
    own = report["table"][0]["all_images"]
    assert (report["method"], own["n_images"], own["n_failed"]) == ("predictions", 3, 2)
    assert own["failure_rate"] == pytest.approx(2 / 3)
    assert own["mean"] == pytest.approx(5 / np.linalg.norm(LANDMARKS[45] - LANDMARKS[36]))
    assert (
        "2 not found: ibug/image_004_1.jpg (NaN or infinity in p.npz), ibug/image_005_1.jpg (absent from p.npz)."
        in (printed)
    )


def test_what_a_run_found_can_be_measured_again_by_other_rules(tmp_path, small_model):
    write_ibug(tmp_path)
    found = np.stack([LANDMARKS + [3, 4], np.full((68, 2), np.nan)])
    np.savez(tmp_path / "p.npz", names=["image_003_1", "image_004_1"], landmarks=found)
    assert measure(tmp_path, "--predictions", tmp_path / "p.npz", "--frame", "half-pixel") == 0
    first = stored_report(tmp_path)
    eye_distance = np.linalg.norm(LANDMARKS[45] - LANDMARKS[36])
    assert [face["errors"]["68"] for face in first["faces"]] == [pytest.approx(5 / eye_distance), None]
    (tmp_path / "out" / "landmarks.npz").rename(tmp_path / "again.npz")
    assert measure(tmp_path, "--predictions", tmp_path / "again.npz") == 0
    for old, new in zip(first["faces"], stored_report(tmp_path)["faces"], strict=True):
        assert (old["failure"] is None) == (new["failure"] is None)
        assert new["errors"]["68"] == (None if old["failure"] else pytest.approx(old["errors"]["68"]))
    assert measure(tmp_path, "--predictions", tmp_path / "again.npz", "--normaliser", "box-diagonal") == 0
    again = stored_report(tmp_path)
    assert again["benchmark"]["normaliser"] == "box-diagonal"
    assert again["faces"][0]["errors"]["68"] == pytest.approx(5 / np.hypot(*np.ptp(LANDMARKS, axis=0)))


def test_a_picture_that_is_damaged_does_not_stop_what_is_measured_without_it(tmp_path, small_model):
    write_ibug(tmp_path)
    (tmp_path / "ibug" / "image_003_1.jpg").write_bytes(b"")
    predictions_for(tmp_path / "p.npz", ["image_003_1", "image_004_1"])
    assert measure(tmp_path, "--predictions", tmp_path / "p.npz") == 0
    assert stored_report(tmp_path)["n_evaluated"] == 2
    assert run(tmp_path, "--data", tmp_path) == 3
    assert stored_report(tmp_path)["unreadable"][0]["name"] == "ibug/image_003_1.jpg"


def test_the_oracle_is_called_what_it_is(tmp_path, small_model, capsys):
    write_ibug(tmp_path)
    assert measure(tmp_path, "--oracle", "--landmark-type", "3d") == 0
    printed = capsys.readouterr().out
    assert "Landmarks: fixed points of the model [3d]." in printed
    assert "Row oracle: NOT A RESULT: the model fitted to the truth itself" in printed
    assert "the model fitted to the true 2D landmarks" in printed
    assert stored_report(tmp_path)["table"][0]["all_images"]["mean"] < 0.01
    assert measure(tmp_path, "--oracle") == 0
    assert "with the jaw on the visible outline [2d]." in capsys.readouterr().out
    assert stored_report(tmp_path)["landmark_type"] == "2d"


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["image_003_1", "image_003_1.jpg"], "each face of ibug"),
        (["image_003_1", "mine"], "expected names of ibug"),
    ],
)
def test_names_that_cannot_be_meant_are_one_line(tmp_path, small_model, capsys, names, message):
    write_ibug(tmp_path)
    predictions_for(tmp_path / "p.npz", names)
    assert measure(tmp_path, "--predictions", tmp_path / "p.npz") == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_annotations_of_another_number_and_without_extent_are_listed(tmp_path, small_model, capsys):
    write_ibug(tmp_path, ("image_003_1", "image_004_1", "image_005_1", "image_006"))
    write_pts(tmp_path / "ibug" / "image_003_1.pts", LANDMARKS[:51])
    write_pts(tmp_path / "ibug" / "image_004_1.pts", np.full((68, 2), 7.0))
    write_pts(tmp_path / "ibug" / "image_005_1.pts", LANDMARKS * [1, np.nan])
    predictions_for(tmp_path / "p.npz", ["image_006"])
    assert measure(tmp_path, "--predictions", tmp_path / "p.npz") == 3
    reasons = {face["name"]: face["reason"] for face in stored_report(tmp_path)["unreadable"]}
    assert "expected 68 points" in reasons["ibug/image_003_1.jpg"]
    assert "normaliser outer-eye, found 0.0 px" in reasons["ibug/image_004_1.jpg"]
    assert "found 68 missing" in reasons["ibug/image_005_1.jpg"]
    assert all("\n" not in reason for reason in reasons.values())


def test_clips_are_drawn_as_a_whole_and_counted(tmp_path, small_model, capsys):
    for clip in ("401", "402", "001"):
        for frame in ("000001", "000002"):
            write_photograph(tmp_path / clip / "imgs" / f"{frame}.png")
            write_pts(tmp_path / clip / "annot" / f"{frame}.pts", LANDMARKS)
    assert measure(tmp_path, "--oracle", "--no-allow-missing", split="300vw") == 3
    assert measure(tmp_path, "--oracle", split="300vw") == 0
    printed, report = capsys.readouterr().out, stored_report(tmp_path)
    assert "Evaluated 6 frames of 3 clips; 300vw has 64 clips to test on." in printed
    assert "300-VW; only 2 of 64 clips" in printed
    assert "bootstrap over clips" in printed
    assert report["bootstrap"]["drawn"] == "clips"
    assert report["table"][0]["groups"]["training"]["n_images"] == 2
    assert [face["clip"] for face in report["faces"]] == ["001", "001", "401", "401", "402", "402"]


def write_aflw(folder, n=3):
    """Faces whose true z differs from the mean face's, and their points in space as pixels count from 0."""
    rng, points = np.random.default_rng(0), []
    for number in range(n):
        z = 0.3 * MODEL.mean[MODEL.landmarks["ibug68"], 2] + rng.normal(0, 5, 68)
        write_photograph(folder / f"image0000{2 + 2 * number}.jpg")
        truth = np.vstack([LANDMARKS.T + 0.5, z])
        write_mat(folder / f"image0000{2 + 2 * number}.mat", LANDMARKS, 0, pt3d_68=truth)
        points.append(np.column_stack([LANDMARKS - 0.5, z]))
    return [f"image0000{2 + 2 * number}" for number in range(n)], np.stack(points)


def rows3d(tmp_path):
    table = stored_report(tmp_path)["table3d"]
    return table and {(row["method"], row["points"]): row["all_images"]["mean"] for row in table["table"]}


def test_a_mirrored_z_is_an_error_in_3d(tmp_path, small_model, capsys):
    names, points = write_aflw(tmp_path)
    box = np.sqrt(np.prod(np.ptp(LANDMARKS, axis=0)))
    call = ("--predictions", tmp_path / "p.npz")
    np.savez(tmp_path / "p.npz", names=names, landmarks=points + [0, 0, 40])  # z has no origin
    assert measure(tmp_path, *call, split="aflw2000-3d") == 0
    assert rows3d(tmp_path)["predictions", "68"] == pytest.approx(0, abs=1e-9)
    assert rows3d(tmp_path)["baseline", "68"] > 0.01
    assert "3D: distance in % of the sqrt(width x height)" in capsys.readouterr().out
    assert stored_report(tmp_path)["table3d"]["alignment"] == "depth"

    np.savez(tmp_path / "p.npz", names=names, landmarks=points * [1, 1, -1])
    assert measure(tmp_path, *call, split="aflw2000-3d") == 0
    from_mean = points[..., 2] - points[..., 2].mean(axis=1, keepdims=True)
    expected = (2 * np.abs(from_mean)).mean() / box
    assert stored_report(tmp_path)["table"][0]["all_images"]["mean"] == pytest.approx(0, abs=1e-9)
    assert rows3d(tmp_path)["predictions", "68"] == pytest.approx(expected)
    assert (tmp_path / "out" / "curve3d.png").exists()
    (tmp_path / "out" / "landmarks.npz").rename(tmp_path / "p.npz")
    assert measure(tmp_path, *call, split="aflw2000-3d") == 0
    assert rows3d(tmp_path)["predictions", "68"] == pytest.approx(expected)


def test_the_curve_in_3d_has_the_unit_of_the_table(tmp_path, small_model, monkeypatch):
    names, points = write_aflw(tmp_path)
    np.savez(tmp_path / "p.npz", names=names, landmarks=points * [1, 1, 1.01])
    drawn = {}
    monkeypatch.setattr(
        "pix2face.evaluation.report.report_pictures._curves_png",
        lambda curves, title, label, n: drawn.update({label: curves["predictions, 68 points"]}) or b"\x89PNG",
    )
    assert measure(tmp_path, "--predictions", tmp_path / "p.npz", split="aflw2000-3d") == 0
    ((label, curve),) = ((own, curve) for own, curve in drawn.items() if "in 3D" in own)
    assert label.endswith(
        "after alignment (depth),\n% of the sqrt(width x height) of the tight box of the true 68 points"
    )
    mean = 100 * rows3d(tmp_path)["predictions", "68"]
    assert 0 < mean < curve[-1, 0]
    assert curve[curve[:, 0] > 2 * mean, 1].min() == 100


def test_landmarks_of_the_picture_have_no_curve_in_3d(tmp_path, small_model):
    names, points = write_aflw(tmp_path)
    np.savez(tmp_path / "p.npz", names=names[1:], landmarks=points[1:, :, :2])  # one face is absent
    assert measure(tmp_path, "--predictions", tmp_path / "p.npz", split="aflw2000-3d") == 0
    assert rows3d(tmp_path) is None
    assert (tmp_path / "out" / "curve.png").exists()
    assert not (tmp_path / "out" / "curve3d.png").exists()


def test_landmarks_of_two_dimensions_have_no_row_in_3d(tmp_path, small_model):
    names, points = write_aflw(tmp_path)
    points[1] = np.nan
    np.savez(tmp_path / "p.npz", names=names, landmarks=points[..., :2])
    assert measure(tmp_path, "--predictions", tmp_path / "p.npz", split="aflw2000-3d") == 0
    assert rows3d(tmp_path) is None


def test_faces_that_were_not_found_count_in_3d(tmp_path, small_model):
    names, points = write_aflw(tmp_path)
    np.savez(tmp_path / "p.npz", names=names[:2], landmarks=points[:2])
    assert measure(tmp_path, "--predictions", tmp_path / "p.npz", split="aflw2000-3d") == 0
    own = stored_report(tmp_path)["table3d"]["table"][0]["all_images"]
    assert (own["n_images"], own["n_failed"]) == (3, 1)


def test_fits_have_a_row_in_3d(tmp_path, small_model):
    write_aflw(tmp_path)
    assert measure(tmp_path, "--oracle", split="aflw2000-3d") == 0
    assert 0 < rows3d(tmp_path)["oracle", "68"] < rows3d(tmp_path)["baseline", "68"] + 0.05


@pytest.mark.parametrize(("split", "align"), [("aflw2000-3d", "rigid"), ("ibug", "similarity"), ("ibug", "depth")])
def test_alignments_that_a_split_cannot_have_are_refused(tmp_path, small_model, capsys, split, align):
    assert measure(tmp_path, "--oracle", "--align", align, split=split) == 2
    assert f"--align {align}: expected a split with 3D landmarks" in capsys.readouterr().err
