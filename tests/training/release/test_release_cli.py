"""A trained checkpoint becomes a release: half the size, the same maps, a card with the figures of a report."""

import json
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

from pix2face.errors import UsageError
from pix2face.geometry.crops import FaceBox
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.predictor import Predictor
from pix2face.inference.torch_networks import load_checkpoint, save_checkpoint
from pix2face.landmark_choice.landmark_file import save_landmarks, with_own_landmarks
from pix2face.landmark_choice.landmark_offsets import LandmarkSelection
from pix2face.networks.dimensions import residual_widths
from pix2face.networks.residual import ResidualUNet
from tests.pix2face.benchmark_files import write_heldout
from tests.pix2face.evaluation_calls import MODEL, run, stored_report, write_ibug
from training.cli import main

HEADER = CheckpointHeader(
    model_name="small head",
    model_sha256=MODEL.sha256,
    size_px=64,
    widths=residual_widths(2),
    pncc_scale_mm=150.0,
    offset_scale_mm=20.0,
    smallest_radius_mm=MODEL.smallest_radius_mm,
    licence="CC0-1.0",
    configuration='{"seed": 0, "samples": 5, "samples_sha256": "abc", "weights": {"pncc": 1, "offset": 4}}',
    epoch=3,
    samples=7200,
    architecture="residual",
    planes=8,
)


@pytest.fixture
def checkpoint(tmp_path):
    torch.manual_seed(0)
    network = ResidualUNet(HEADER.widths, HEADER.planes)
    network(torch.rand(4, 3, 64, 64) - 0.5)
    save_checkpoint(tmp_path / "run" / "checkpoint.safetensors", HEADER, network)
    return tmp_path / "run" / "checkpoint.safetensors"


def test_weights_of_half_the_size_predict_the_same(checkpoint, tmp_path):
    assert main(["export", str(checkpoint), "--out", str(tmp_path / "release"), "--no-onnx"]) == 0
    released = tmp_path / "release" / "checkpoint.safetensors"
    assert released.stat().st_size < 0.7 * checkpoint.stat().st_size
    assert load_checkpoint(released)[0] == HEADER
    picture = np.random.default_rng(0).integers(0, 256, (100, 100, 3)).astype(np.uint8)
    whole, half = (
        Predictor.load(path, "cpu").predict(picture, FaceBox(20, 20, 80, 80)) for path in (checkpoint, released)
    )
    both = whole.maps.mask & half.maps.mask
    assert (whole.maps.mask ^ half.maps.mask).mean() < 0.02
    np.testing.assert_allclose(half.maps.pncc[both], whole.maps.pncc[both], atol=2.0)


def test_a_release_brings_its_own_landmarks_along(checkpoint, tmp_path):
    chosen = (MODEL.landmarks["ibug68"].astype(int) + 1) % len(MODEL.mean)
    offsets = np.tile([0.5, -1.25, 2.0], (68, 1))
    selection = LandmarkSelection(chosen, offsets, *(np.zeros(68) for _ in range(2)), np.ones(68, int))
    save_landmarks(tmp_path / "landmarks.json", MODEL, "ibug68", selection, {})
    inner = LandmarkSelection(chosen[17:], np.zeros((51, 3)), *(np.zeros(51) for _ in range(2)), np.ones(51, int))
    save_landmarks(tmp_path / "inner.json", MODEL, "inner51", inner, {})
    landmarks = ["--landmarks", str(tmp_path / "landmarks.json"), str(tmp_path / "inner.json")]
    assert main(["export", str(checkpoint), "--out", str(tmp_path / "release"), "--no-onnx", *landmarks]) == 0
    header, _ = load_checkpoint(tmp_path / "release" / "checkpoint.safetensors")
    own = with_own_landmarks(MODEL, header)
    np.testing.assert_array_equal(own.landmarks["ibug68"], chosen)
    np.testing.assert_array_equal(own.mean_landmarks("ibug68"), MODEL.mean[chosen] + offsets)
    np.testing.assert_array_equal(with_own_landmarks(MODEL, header).landmarks["inner51"], chosen[17:])
    np.testing.assert_array_equal(with_own_landmarks(MODEL, HEADER).landmarks["ibug68"], MODEL.landmarks["ibug68"])
    assert "chosen on its fits" in (tmp_path / "release" / "README.md").read_text()
    with pytest.raises(UsageError, match="expected vertices of 0 to"):
        with_own_landmarks(MODEL, replace(header, landmarks={"ibug68": (10**6,)}))
    with pytest.raises(UsageError, match="an offset for each of 68 landmarks, found 1"):
        with_own_landmarks(MODEL, replace(header, landmark_offsets_mm={"ibug68": ((0.0, 0.0, 0.0),)}))


def test_onnx_computes_what_the_released_weights_compute(checkpoint, tmp_path, monkeypatch):
    assert main(["export", str(checkpoint), "--out", str(tmp_path / "release")]) == 0
    images = torch.rand(2, 3, 64, 64) - 0.5
    with torch.inference_mode():
        expected = load_checkpoint(tmp_path / "release" / "checkpoint.safetensors")[1](images)
    (lines,) = re.findall("```python\n(.*?)```", (tmp_path / "release" / "README.md").read_text(), re.DOTALL)
    assert lines.count("\n") == 3
    monkeypatch.chdir(tmp_path / "release")
    for package in ("pix2face", "training", "torch"):
        monkeypatch.setitem(sys.modules, package, None)
    names = {"pictures": images.numpy()}
    exec(lines, names)
    assert np.abs(names["planes"] - expected.numpy()).max() <= 1e-4 * np.ptp(expected.numpy())


def test_the_card_says_what_it_is_and_quotes_a_report(checkpoint, tmp_path, monkeypatch):
    monkeypatch.setattr("pix2face.landmark_choice.landmark_file.open_model", lambda name: MODEL)
    write_ibug(tmp_path)
    assert run(tmp_path, "--data", tmp_path) == 0
    report = tmp_path / "out" / "report.json"
    out = tmp_path / "release"
    assert main(["export", str(checkpoint), "--out", str(out), "--no-onnx", "--report", str(report)]) == 0
    card = (out / "README.md").read_text()
    for said in (HEADER.model_sha256, "CC0-1.0", "2-4-8-12-16-16", "7,200 draws", "| weights.offset | 4 |", "abc"):
        assert said in card
    content = stored_report(tmp_path)
    assert content["benchmark"]["title"] in card
    row = next(row for row in content["table"] if row["method"] == content["method"] and row["points"] == "68")
    mean = row["all_images"]["mean"]
    assert f"| 68 | all images | {'none' if mean is None else f'{mean:.2%}'} |" in card


def test_the_card_tells_errors_of_renders_apart_by_skin_tone(checkpoint, tmp_path, monkeypatch):
    monkeypatch.setattr("pix2face.landmark_choice.landmark_file.open_model", lambda name: MODEL)
    write_heldout(tmp_path / "shards", MODEL, n=8)
    call = ("--data", tmp_path / "shards", "--by", "skin.melanin")
    assert run(tmp_path, *call, split="builtin-heldout") == 0
    report = stored_report(tmp_path)
    light, dark = report["by"][0]["bins"][::3]
    assert light["errors"]["n_failed"] == 2  # a network that has learned nothing finds no face
    dark["errors"] |= {"n_failed": 0, "mean": 0.0409, "median": 0.0354, "failure_rate": 0.02}
    dark["interval"] = [0.0384, 0.0439]
    dark["name"] = "0.5 | to\n0.7"
    (tmp_path / "report.json").write_text(json.dumps(report))
    quoted = ["--report", str(tmp_path / "report.json")]
    assert main(["export", str(checkpoint), "--out", str(tmp_path / "release"), "--no-onnx", *quoted]) == 0
    card = (tmp_path / "release" / "README.md").read_text()
    assert "landmarks: those of the model:" in card
    assert "| `skin.melanin` | images | not found | mean | median | above the threshold | 95 % interval |" in card
    assert f"| {light['name']} | 2 | 2 | none | none | 100.00% | none |" in card
    assert "| 0.5 / to 0.7 | 2 | 0 | 4.09% | 3.54% | 2.00% | 3.84% to 4.39% |" in card


def test_without_a_report_the_card_says_that_nothing_was_measured(checkpoint, tmp_path):
    assert main(["export", str(checkpoint), "--out", str(tmp_path / "release"), "--no-onnx"]) == 0
    card = (tmp_path / "release" / "README.md").read_text()
    assert "No report was given. `train export --report" in card
    assert (
        "`pix2face export --checkpoint checkpoint.safetensors --out network.onnx` writes the network as ONNX." in card
    )


def test_what_is_no_report_or_no_checkpoint_is_one_line(checkpoint, tmp_path, capsys):
    (tmp_path / "other.json").write_text(json.dumps({"format": "something else"}))
    call = ["export", str(checkpoint), "--out", str(tmp_path / "release"), "--no-onnx"]
    assert main([*call, "--report", str(tmp_path / "other.json")]) == 2
    assert "expected a report that `evaluate` wrote" in capsys.readouterr().err
    assert main(["export", str(tmp_path / "none"), "--out", str(tmp_path / "release")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("train export: error: ")
    assert said.count("\n") == 1
