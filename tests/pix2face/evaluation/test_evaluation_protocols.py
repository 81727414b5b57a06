"""The benchmarks' protocols against computations written out here, on real annotations."""

import json
from functools import cache

import numpy as np
import pytest
import scipy.io

from pix2face.evaluation.cli import main
from tests.pix2face.benchmark_files import frontal_camera, landmarks_of, write_photograph, write_points, write_pts
from tests.synthetic_models import small_head_model

pytestmark = pytest.mark.usefixtures("small_model")
MODEL = small_head_model()
LANDMARKS = landmarks_of(MODEL, frontal_camera())
LENGTHS = {
    "box-sqrt": lambda p: np.sqrt(np.prod(p.max(1) - p.min(1))),
    "outer-eye": lambda p: np.sqrt(((p[:, 45] - p[:, 36]) ** 2).sum()),
}


def figures(dev, reannotated, normaliser, threshold):
    """Everything by NumPy alone: both annotations as they stand in their files, 1-based, (2, 68) each."""
    files = mat_files(dev)
    yaws = np.abs([(np.degrees(file["Pose_Para"][0, 1]) + 180) % 360 - 180 for file in files])
    bins = [yaws <= 30, (yaws > 30) & (yaws <= 60), yaws > 60]
    rows = {}
    for name, first in (("68", 0), ("51", 17)):
        errors = []
        for file, predicted in zip(files, reannotated, strict=True):
            truth = file["pt3d_68"][:2].astype(np.float64)
            distances = np.sqrt(((predicted - truth) ** 2).sum(0))
            errors.append(distances[first:].mean() / LENGTHS[normaliser](truth))
        errors = np.array(errors)
        of_bins = [errors[chosen].mean() for chosen in bins]
        curve = [(errors <= step).mean() for step in np.linspace(0, threshold, 20001)]
        area = np.trapezoid(curve) / 20000
        rows[name] = (of_bins, np.mean(of_bins), errors.mean(), np.median(errors), area, (errors > threshold).mean())
    return rows


@cache
def mat_files(dev):
    return [scipy.io.loadmat(path) for path in sorted(dev.glob("*.mat"))]


@cache
def truths(shared_dir):
    """The names, the original landmarks and the re-annotated ones of the faces at hand, (n, 2, 68) each."""
    data = shared_dir / "data" / "aflw2000_3d"
    with (data / "dev_reannotated_pts68.npy").open("rb") as file:
        reannotated = np.lib.format.read_array(file).astype(np.float64)
    names = [path.stem for path in sorted((data / "dev").glob("*.mat"))]
    original = np.stack([file["pt3d_68"][:2] for file in mat_files(data / "dev")]).astype(np.float64)
    return names, original, reannotated


def evaluated(shared_dir, folder, landmarks, *more):
    """The report of some landmarks in place of predictions."""
    names, _, _ = truths(shared_dir)
    np.savez(folder / "p.npz", names=names, landmarks=np.swapaxes(landmarks, 1, 2))
    call = ["--split", "aflw2000-3d", "--data", str(shared_dir / "data" / "aflw2000_3d"), "--allow-missing"]
    call += ["--predictions", str(folder / "p.npz"), "--frame", "1-based", "--out", str(folder / "out")]
    assert main([*call, *more]) == 0
    return json.loads((folder / "out" / "report.json").read_text())


@pytest.mark.parametrize(("normaliser", "threshold"), [("box-sqrt", 0.04), ("outer-eye", None)])
def test_the_two_truths_of_aflw_differ_by_what_numpy_says(shared_dir, tmp_path, normaliser, threshold):
    _, _, reannotated = truths(shared_dir)
    more = ["--threshold", str(threshold)] if threshold else []
    report = evaluated(shared_dir, tmp_path, reannotated, "--normaliser", normaliser, "--resamples", "20", *more)
    assert report["benchmark"]["normaliser"] == normaliser
    assert report["benchmark"]["threshold"] == (threshold or 0.1)
    dev = shared_dir / "data" / "aflw2000_3d" / "dev"
    for points, expected in figures(dev, reannotated, normaliser, threshold or 0.1).items():
        (row,) = [row for row in report["table"] if (row["method"], row["points"]) == ("predictions", points)]
        of_bins, mean_of_bins, mean, median, area, failures = expected
        np.testing.assert_allclose([own["mean"] for own in row["groups"].values()], of_bins, rtol=1e-5)
        assert row["mean_of_groups"] == pytest.approx(mean_of_bins, rel=1e-5)
        own = row["all_images"]
        assert (own["mean"], own["median"]) == pytest.approx((mean, median), rel=1e-5)
        assert own["area_under_curve"] == pytest.approx(area, abs=1e-4)
        assert own["failure_rate"] == pytest.approx(failures, abs=1e-12)


def test_the_roles_of_the_two_truths_may_be_swapped(shared_dir, tmp_path):
    """The original landmarks as predictions against the re-annotated ones: the same distances, other boxes."""
    _, original, reannotated = truths(shared_dir)
    report = evaluated(shared_dir, tmp_path, original, "--truth", "reannotated", "--resamples", "0")
    distances = np.sqrt(((original - reannotated) ** 2).sum(1)).mean(1)
    lengths = [LENGTHS["box-sqrt"](points) for points in reannotated]
    assert report["table"][0]["all_images"]["mean"] == pytest.approx((distances / lengths).mean(), rel=1e-5)
    assert report["benchmark"]["truth"] == "reannotated"
    assert report["table"][0]["intervals"]["mean"] is None


def test_menpo_is_measured_by_eyes_in_the_plane_and_by_the_datas_unit_in_space(tmp_path):
    """Predictions are off by (3, 4) pixels, and in space by noise, after a turn that alignment must undo."""
    random = np.random.default_rng(0)
    turn = np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 1]])
    space, names = random.normal(0, 5, (3, 68, 3)), []
    noise = random.normal(0, 0.3, space.shape)
    for index, own in enumerate(space):
        folder, frame = tmp_path / "data" / f"clip{index % 2}", f"{index:06d}"
        write_pts(folder / "annot" / f"{frame}.pts", LANDMARKS)
        write_points(folder / "annot3d" / f"{frame}.pts", own)
        write_photograph(folder / "imgs" / f"{frame}.jpg")
        names.append(f"clip{index % 2}/{frame}")
    predicted = np.broadcast_to(LANDMARKS - 0.5 + [3, 4], (3, 68, 2))
    np.savez(tmp_path / "p.npz", names=names, landmarks=predicted, landmarks3d=2 * (space + noise) @ turn.T + 7)
    call = ["--split", "menpo3d-tracking", "--data", str(tmp_path / "data"), "--predictions", str(tmp_path / "p.npz")]
    call.append("--allow-missing")
    figures = {}
    for alignment in ("none", "rigid", "similarity"):
        assert main([*call, "--align", alignment, "--out", str(tmp_path / alignment), "--resamples", "30"]) == 0
        report = json.loads((tmp_path / alignment / "report.json").read_text())
        assert report["table3d"]["alignment"] == alignment
        assert f"[{alignment}]" in (tmp_path / alignment / "index.html").read_text()
        assert (tmp_path / alignment / "curve3d.png").is_file()
        figures[alignment] = report["table3d"]["table"][0]["all_images"]["mean"]
    eyes = np.linalg.norm(LANDMARKS[45] - LANDMARKS[36])
    assert report["table"][0]["all_images"]["mean"] == pytest.approx(5 / eyes)
    assert report["bootstrap"]["drawn"] == "clips"
    by_hand = []
    for own, off in zip(space, noise, strict=True):
        moved, true = own + off - (own + off).mean(0), own - own.mean(0)
        u, s, vt = np.linalg.svd(true.T @ moved)
        fitted = s.sum() / (moved**2).sum() * moved @ (u @ vt).T
        by_hand.append(np.sqrt(((fitted - true) ** 2).sum(1)).mean())
    assert figures["similarity"] == pytest.approx(np.mean(by_hand), rel=1e-6)
    assert figures["none"] > figures["rigid"] > 5 * figures["similarity"]
