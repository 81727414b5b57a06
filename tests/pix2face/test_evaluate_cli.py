"""The command from its arguments to files and exit status, with a network that has learned nothing."""

import json

import numpy as np
import pytest
import torch

from pix2face.checkpoint import CheckpointHeader, save_checkpoint
from pix2face.evaluate_cli import main
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
    monkeypatch.setattr("pix2face.evaluate_cli.open_model", lambda name: MODEL)


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
