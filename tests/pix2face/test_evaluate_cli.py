"""The command from its arguments to files and exit status, with a network that has learned nothing."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest
import torch
import tyro

from pix2face.checkpoint import CheckpointHeader, save_checkpoint
from pix2face.compare_cli import CompareConfig
from pix2face.evaluate_cli import EvaluateConfig, main
from pix2face.manifest import SPLITS
from pix2face.network import UNet
from tests.pix2face.benchmark_files import (
    frontal_camera,
    landmarks_of,
    write_heldout,
    write_mat,
    write_photograph,
    write_pts,
)
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
LANDMARKS = landmarks_of(MODEL, frontal_camera())


@pytest.fixture
def small_model(monkeypatch):
    """Whatever --model says, the small head is opened: evaluation needs no particular face."""
    monkeypatch.setattr("pix2face.landmark_file.open_model", lambda name: MODEL)


def write_checkpoint(path, model_name=MODEL.name, model_sha256=MODEL.sha256):
    torch.manual_seed(0)
    header = CheckpointHeader(
        model_name=model_name,
        model_sha256=model_sha256,
        size_px=32,
        filters=4,
        pncc_scale_mm=150.0,
        offset_scale_mm=20.0,
        smallest_radius_mm=MODEL.smallest_radius_mm,
        licence="CC0",
        configuration='{"preset": "test"}',
        epoch=2,
    )
    save_checkpoint(path, header, UNet(32, 4))
    return path


def run(tmp_path, *arguments, split="ibug"):
    checkpoint = tmp_path / "checkpoint.safetensors"
    if not checkpoint.exists():
        write_checkpoint(checkpoint)
    out = tmp_path / "out"
    return main(["--split", split, "--checkpoint", str(checkpoint), "--out", str(out), *map(str, arguments)])


def write_ibug(folder, names=("image_003_1", "image_004_1")):
    for name in names:
        write_photograph(folder / "ibug" / f"{name}.jpg")
        write_pts(folder / "ibug" / f"{name}.pts", LANDMARKS)


def test_photographs_give_a_table_and_files_with_every_face_counted(tmp_path, small_model, capsys):
    write_ibug(tmp_path)
    assert run(tmp_path, "--data", tmp_path) == 0
    printed = capsys.readouterr().out
    assert "Row baseline: the mean face" in printed
    assert "133 missing: ibug/image_005_1.jpg" in printed
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert (report["n_evaluated"], report["n_missing"]) == (2, 133)
    assert report["subject"]["configuration"]["split"] == "ibug"
    assert report["subject"]["checkpoint_header"]["configuration"] == {"preset": "test"}
    assert len(report["subject"]["hashes"]["checkpoint"]) == 64
    assert report["table"][2]["all_images"]["mean"] == pytest.approx(0, abs=1e-6)  # the mean face itself


def test_data_folder_from_the_environment(tmp_path, small_model, monkeypatch):
    write_ibug(tmp_path)
    monkeypatch.setenv("PIX2FACE_DATA", str(tmp_path))
    assert run(tmp_path) == 0


def test_without_data_one_line_says_where_it_is(tmp_path, small_model, monkeypatch, capsys):
    monkeypatch.delenv("PIX2FACE_DATA", raising=False)
    assert run(tmp_path) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "iBUG, Imperial College London" in error
    assert "DATA/ibug/image_003_1.jpg" in error


def test_damaged_faces_are_listed_and_decide_the_exit_status(tmp_path, small_model, capsys):
    write_ibug(tmp_path, ("image_003_1", "image_004_1", "image_005_1"))
    damaged = tmp_path / "ibug" / "image_004_1.pts"
    damaged.write_bytes(damaged.read_bytes()[:100])
    assert run(tmp_path, "--data", tmp_path) == 3
    assert "1 unreadable: ibug/image_004_1.jpg" in capsys.readouterr().out
    assert json.loads((tmp_path / "out" / "report.json").read_text())["n_evaluated"] == 2
    assert run(tmp_path, "--data", tmp_path, "--max-rejected", 1) == 0


def test_fewer_than_no_rejected_faces_are_one_line(tmp_path, small_model, capsys):
    assert run(tmp_path, "--data", tmp_path, "--max-rejected", -1) == 2
    assert capsys.readouterr().err == "evaluate: error: --max-rejected: expected 0 or more, found -1\n"


def test_where_no_face_can_be_evaluated_the_reasons_are_all(tmp_path, small_model, capsys):
    write_ibug(tmp_path)
    for name in ("image_003_1", "image_004_1"):
        (tmp_path / "ibug" / f"{name}.pts").write_bytes(b"version: 1\n")
    assert run(tmp_path, "--data", tmp_path, "--max-rejected", 9) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    reasons = captured.err.splitlines()[-3:-1]
    assert [reason.split(":")[0] for reason in reasons] == ["ibug/image_003_1.jpg", "ibug/image_004_1.jpg"]
    assert captured.err.splitlines()[-1].startswith("evaluate: error: ibug: expected at least one face")
    assert "found 2 unreadable files" in captured.err
    assert not (tmp_path / "out" / "report.json").exists()


def test_yaw_bins_of_aflw(tmp_path, small_model, capsys):
    for name, yaw_deg in (("image00002", 5), ("image00004", 50), ("image00006", -80)):
        write_photograph(tmp_path / f"{name}.jpg")
        write_mat(tmp_path / f"{name}.mat", LANDMARKS, yaw_deg)
    write_mat(tmp_path / "image00006.mat", LANDMARKS, -80, Exp_Para=np.full((29, 1), np.nan))
    assert run(tmp_path, "--data", tmp_path, "--max-rejected", 1, split="aflw2000-3d") == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    groups = report["table"][0]["groups"]
    assert [groups[name]["n_images"] for name in groups] == [1, 1, 0]
    assert report["unreadable"][0]["name"] == "aflw2000-3d/image00006.jpg"


def test_heldout_renders(tmp_path, small_model, capsys):
    write_heldout(tmp_path / "shards", MODEL)
    assert run(tmp_path, "--data", tmp_path / "shards", split="builtin-heldout") == 0
    printed = capsys.readouterr().out
    assert "mask IoU" in printed
    assert "98 missing: seed1000000/0000002, " in printed
    assert json.loads((tmp_path / "out" / "report.json").read_text())["n_missing"] == 98


def test_training_shards_are_no_benchmark(tmp_path, small_model, capsys):
    write_heldout(tmp_path / "shards", MODEL, seed=0)
    assert run(tmp_path, "--data", tmp_path / "shards", split="builtin-heldout") == 2
    error = capsys.readouterr().err
    assert "found seed0/0000000" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_file_in_the_way_of_the_report_is_said_before_evaluating(tmp_path, small_model, monkeypatch, capsys):
    write_ibug(tmp_path)
    (tmp_path / "out").write_bytes(b"kept")
    monkeypatch.delattr("pix2face.evaluate_cli.evaluate_faces")
    assert run(tmp_path, "--data", tmp_path) == 2
    error = capsys.readouterr().err
    assert "expected a folder that can be written to, found that" in error
    assert error.count("\n") == 1


def test_checkpoint_of_another_model_names_both(tmp_path, small_model, capsys):
    write_ibug(tmp_path)
    write_checkpoint(tmp_path / "checkpoint.safetensors", "Basel", "e" * 64)
    assert run(tmp_path, "--data", tmp_path) == 2
    error = capsys.readouterr().err
    assert "Basel" in error
    assert MODEL.name in error


def test_truncated_checkpoint_is_named(tmp_path, small_model, capsys):
    write_ibug(tmp_path)
    checkpoint = write_checkpoint(tmp_path / "checkpoint.safetensors")
    checkpoint.write_bytes(checkpoint.read_bytes()[:200])
    assert run(tmp_path, "--data", tmp_path) == 2
    assert "checkpoint.safetensors" in capsys.readouterr().err


def test_the_last_trained_checkpoint_is_the_default(tmp_path, small_model, monkeypatch, capsys):
    write_ibug(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(["--split", "ibug", "--data", "."]) == 2
    assert "train --shards" in capsys.readouterr().err
    write_checkpoint(tmp_path / "runs" / "tiny" / "checkpoint.safetensors")
    assert main(["--split", "ibug", "--data", "."]) == 0
    assert (tmp_path / "out" / "evaluate-ibug" / "report.json").is_file()


def test_unknown_split_is_refused_by_the_parser(capsys):
    with pytest.raises(SystemExit) as caught:
        main(["--split", "cofw"])
    assert caught.value.code == 2


def predictions_for(path, names, landmarks2d=LANDMARKS, n=None):
    np.savez(path, names=names, landmarks=np.stack([landmarks2d - 0.5] * (len(names) if n is None else n)))
    return path


def measure(tmp_path, *arguments, split="ibug"):
    call = ["--split", split, "--data", tmp_path, "--out", tmp_path / "out", "--resamples", 20, *arguments]
    return main([str(argument) for argument in call])


def stored_report(tmp_path):
    return json.loads((tmp_path / "out" / "report.json").read_text())


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
    assert run(tmp_path, "--data", tmp_path) == 0
    first = stored_report(tmp_path)
    (tmp_path / "out" / "landmarks.npz").rename(tmp_path / "again.npz")
    assert measure(tmp_path, "--predictions", tmp_path / "again.npz") == 0
    again = stored_report(tmp_path)
    for old, new in zip(first["faces"], again["faces"], strict=True):
        assert old["failure"] is None or new["failure"] is not None
        assert new["errors"]["68"] == pytest.approx(old["errors"]["68"]) if old["errors"]["68"] else True
    assert measure(tmp_path, "--predictions", tmp_path / "again.npz", "--normaliser", "box-diagonal") == 0
    assert stored_report(tmp_path)["benchmark"]["normaliser"] == "box-diagonal"


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
    assert measure(tmp_path, "--oracle") == 0
    printed = capsys.readouterr().out
    assert "Row oracle: NOT A RESULT: the model fitted to the truth itself" in printed
    assert "the model fitted to the true 2D landmarks" in printed
    assert stored_report(tmp_path)["table"][0]["all_images"]["mean"] < 0.01
    assert measure(tmp_path, "--oracle", "--contour", "2d") == 0
    assert "slide to the visible outline (--contour 2d)" in capsys.readouterr().out


def test_a_detectors_misses_are_failures(tmp_path, small_model, capsys):
    write_ibug(tmp_path)  # noise: there is no face to be found
    assert run(tmp_path, "--data", tmp_path, "--boxes", "lbp") == 0
    report, printed = stored_report(tmp_path), capsys.readouterr().out
    assert report["n_failed"] == 2
    assert report["table"][0]["all_images"]["mean"] is None
    assert report["table"][0]["all_images"]["failure_rate"] == 1
    assert "of the boxes of the detector lbp" in printed
    assert "2 not found: ibug/image_003_1.jpg (detector lbp: no face)" in printed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--threshold", 0], "expected a positive --threshold"),
        (["--threshold", "nan"], "expected a positive --threshold"),
        (["--batch-size", 0], "--batch-size: expected 1 or more, found 0"),
        (["--resamples", -1], "--resamples: expected 0 or more, found -1"),
        (["--seed", -1], "--seed: expected 0 or more"),
        (["--frame", "1-based"], "--frame 1-based: expected --predictions with it"),
        (["--oracle", "--predictions", "p.npz"], "expected one of --checkpoint, --predictions and --oracle"),
        (["--truth", "reannotated"], "ibug: expected hand-marked as --truth, found reannotated"),
        (["--align", "rigid"], "--align rigid: expected a split with 3D landmarks, found ibug"),
        (["--oracle", "--boxes", "lbp"], "--boxes lbp: expected a checkpoint"),
        (["--predictions", "p.npz", "--contour", "2d"], "--contour 2d: expected a fit"),
        (["--reannotated", "x.npy"], "expected --truth reannotated with it"),
        (["--predictions", "absent.npz"], "absent.npz: expected an .npz file of predictions"),
    ],
)
def test_calls_that_cannot_be_meant_are_one_line(tmp_path, small_model, capsys, arguments, message):
    write_ibug(tmp_path)
    assert measure(tmp_path, *arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_contour_is_for_truths_that_follow_it(tmp_path, small_model, capsys):
    assert measure(tmp_path, "--contour", "2d", split="aflw2000-3d") == 2
    assert "--contour 2d: expected a split whose truth follows the visible outline" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("names", "n", "message"),
    [
        (["image_003_1", "image_003_1"], None, "each name once, found 'image_003_1' 2 times"),
        (["image_003_1", "image_003_1.jpg"], None, "each face of ibug"),
        (["image_003_1", "mine"], None, "expected names of ibug"),
        (["image_003_1", "image_004_1"], 3, "expected landmarks as numbers of shape"),
    ],
)
def test_names_that_cannot_be_meant_are_one_line(tmp_path, small_model, capsys, names, n, message):
    write_ibug(tmp_path)
    predictions_for(tmp_path / "p.npz", names, n=n)
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
    assert "finite" in reasons["ibug/image_005_1.jpg"]
    assert all("\n" not in reason for reason in reasons.values())


def test_clips_are_drawn_as_a_whole_and_counted(tmp_path, small_model, capsys):
    for clip in ("401", "402", "001"):
        for frame in ("000001", "000002"):
            write_photograph(tmp_path / clip / "imgs" / f"{frame}.png")
            write_pts(tmp_path / clip / "annot" / f"{frame}.pts", LANDMARKS)
    assert measure(tmp_path, "--oracle", "--contour", "2d", split="300vw") == 0
    printed, report = capsys.readouterr().out, stored_report(tmp_path)
    assert "Evaluated 6 frames of 3 clips; 300vw has 64 clips to test on." in printed
    assert "bootstrap over clips" in printed
    assert report["bootstrap"]["drawn"] == "clips"
    assert report["table"][0]["groups"]["training"]["n_images"] == 2
    assert [face["clip"] for face in report["faces"]] == ["001", "001", "401", "401", "402", "402"]


@pytest.mark.parametrize("page", ["README.md", "docs/evaluation.md", "docs/reproduce.md"])
def test_every_evaluation_in_the_docs_parses(page):
    text = (Path(__file__).parents[2] / page).read_text(encoding="utf-8")
    calls = re.findall(r"(?:^    |`|&& )(evaluate (?:--split|compare) [^`#\n]*)", text, re.MULTILINE)
    assert calls
    for call in calls:
        words = shlex.split(call)[1:]
        if "S" in words:  # evaluate --split S: any of them
            continue
        if words[0] == "compare":
            assert len(tyro.cli(CompareConfig, args=words[1:]).reports) == 2
        else:
            assert tyro.cli(EvaluateConfig, args=words).split in SPLITS
