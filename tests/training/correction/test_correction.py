"""``train correction``: what it is told is true, it goes on where it was interrupted, and its fits are better."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
import torch

from pix2face.fitting.face_fit import fit_face
from pix2face.fitting.fit_options import FitOptions
from pix2face.fitting.prepared_model import spread_vertices, vertex_basis
from pix2face.geometry.crops import FaceBox
from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM
from pix2face.inference.fit_correction import camera_of_rows
from pix2face.inference.predictor import Predictor
from pix2face.inference.torch_networks import load_checkpoint, save_checkpoint
from pix2face.networks.correction import rotation_and_scale
from pix2face.networks.residual import ResidualUNet
from pix2face.shards.shard_reader import ShardReader, shard_paths
from tests.synthetic_models import small_head_model
from tests.training.conftest import copy_with_a_damaged_sample
from training import task_cli, task_run
from training.cli import main
from training.correction.correction_loss import WEIGHTS, CorrectionLosses
from training.correction.fitting_network import ReadFaces
from training.correction.known_faces import KnownCrops, KnownFaces
from training.data.batches import target_planes
from training.data.shard_index import index_shards
from training.loop.losses import LossPlan
from training.loop.trainer import Observers, train_task
from training.recipe.recipe import LossWeights

pytestmark = pytest.mark.xdist_group("correction")  # the whole training runs once

MODEL = small_head_model()
VERTICES = spread_vertices(MODEL, 30)
FACE = MODEL.mean[VERTICES], vertex_basis(MODEL, VERTICES)


@pytest.fixture(autouse=True, scope="module")
def _small_head() -> Iterator[None]:
    with patch.object(task_cli, "open_model", lambda name: MODEL):
        yield


@pytest.fixture(scope="module")
def batch(shards_dir: Path, network_path: Path) -> KnownFaces:
    header, _ = load_checkpoint(network_path)
    shards = replace(index_shards([shards_dir]), mirror_obstacle="")  # the small head is symmetric
    return KnownCrops(shards, MODEL, FACE, header, seed=0).batch(range(20))


def test_true_faces_project_to_the_true_places(batch: KnownFaces) -> None:
    """Also mirrored ones, whose coefficients are those of the mirrored face. So do the points of the maps."""
    mean, basis = FACE
    for camera, coefficients, points2d in zip(batch.cameras, batch.coefficients, batch.points2d, strict=True):
        points3d = mean + basis @ coefficients.numpy()
        projected = camera_of_rows(camera.double().numpy(), 64).project(points3d)
        np.testing.assert_allclose(projected, 64 * (points2d.numpy() + 0.5), atol=0.02)
    for camera, pncc, offset, mask in zip(
        batch.cameras, batch.maps.pncc, batch.maps.offset, batch.maps.mask, strict=True
    ):
        points3d = (pncc + offset).permute(1, 2, 0)[mask.bool()].numpy() / FIXED_POINT_STEPS_PER_MM
        projected = camera_of_rows(camera.double().numpy(), 64).project(points3d)
        rows, columns = np.nonzero(mask.numpy())
        errors_px = np.linalg.norm(projected - np.column_stack([columns, rows]) - 0.5, axis=1)
        assert np.median(errors_px) < 0.3
    # All faces look at the viewer, so the model's x leads to the right, in mirrored crops as well.
    rotation, _ = rotation_and_scale(batch.cameras)
    assert rotation[:, 0, 0].amin() > 0.5
    # The nose is in the middle of each crop, which is 1.4 times as large as the face.
    assert batch.points2d.abs().amax() < 0.6
    assert (batch.points2d.amax(dim=1) - batch.points2d.amin(dim=1)).amin() > 0.4


def test_the_loss_of_the_truth_is_zero(batch: KnownFaces) -> None:
    maps = LossPlan(pncc_scale_mm=1.0, offset_scale_mm=1.0, weights=LossWeights(linear=1.0), over="mask")
    losses = CorrectionLosses(*FACE, maps)
    truth = ReadFaces(
        planes=target_planes(batch.maps, 1.0, 1.0),
        landmarks=None,
        is_fitted=torch.ones(len(batch), dtype=torch.bool),
        fitted_coefficients=batch.coefficients,
        cameras=batch.cameras,
        coefficients=batch.coefficients,
    )
    parts = losses.parts(truth, batch)
    assert {name: round(float(part), 3) for name, part in parts.items()} == dict.fromkeys(parts, 0)
    turned = batch.cameras @ torch.tensor(np.diag([1.0, 0.9, 1.1, 1.0]), dtype=torch.float32)
    worse = losses.parts(replace(truth, cameras=turned, coefficients=0.5 * batch.coefficients), batch)
    assert all(float(worse[name]) > 0 for name in WEIGHTS)
    assert float(losses.total(worse)) > float(losses.total(parts))
    # Faces that were not found do not count.
    lost = replace(truth, cameras=turned, is_fitted=torch.zeros(len(batch), dtype=torch.bool))
    assert float(losses.total(losses.parts(lost, batch))) == 0


def arguments(shards: Path, network: Path, out: Path, *more: str) -> list[str]:
    numbers = ["--batch-size", "4", "--epochs", "2", "--epoch-size", "8", "--workers", "0"]
    sources = ["--shards", str(shards), "--checkpoint", str(network)]
    return ["correction", *sources, "--out", str(out), *numbers, *more]


@pytest.fixture(scope="module")
def corrected(
    _small_head: None, shards_dir: Path, network_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """The checkpoint of a whole training."""
    out = tmp_path_factory.mktemp("corrected")
    assert main(arguments(shards_dir, network_path, out)) == 0
    return out / "checkpoint.safetensors"


def weights(path: Path) -> dict[str, torch.Tensor]:
    return load_checkpoint(path)[1].state_dict()


def test_it_goes_on_where_it_was_stopped(
    corrected: Path, shards_dir: Path, network_path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    def stopped(task, out, surroundings, observers):
        return train_task(task, out, surroundings, observers=Observers(should_stop=lambda: True))

    with monkeypatch.context() as patched:
        patched.setattr(task_run, "train_task", stopped)
        assert main(arguments(shards_dir, network_path, tmp_path / "parts")) == 143
    assert main(arguments(shards_dir, network_path, tmp_path / "parts", "--seed", "1")) == 2
    assert "seed 0 -> 1" in capsys.readouterr().err
    assert main(arguments(shards_dir, network_path, tmp_path / "parts")) == 0
    assert (tmp_path / "parts" / "checkpoint.safetensors").read_bytes() == corrected.read_bytes()
    assert main(arguments(shards_dir, network_path, tmp_path / "parts", "--seed", "1", "--restart")) == 0
    before, _ = load_checkpoint(network_path)
    header, _ = load_checkpoint(corrected)
    assert header.n_corrected == MODEL.n_identity + MODEL.n_expression
    assert json.loads(header.configuration)["correction"]["fits"] == 16
    assert (header.samples, header.widths) == (before.samples, before.widths)


def test_two_processes_share_the_work(shards_dir: Path, network_path: Path, tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text(
        "import sys\n"
        "from tests.synthetic_models import small_head_model\n"
        "from training.cli import main\n"
        "from training import task_cli\n"
        "task_cli.open_model = lambda name: small_head_model()\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    started = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2", str(program)]
    out = tmp_path / "out"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3]), "OMP_NUM_THREADS": "1"}
    subprocess.run([*started, *arguments(shards_dir, network_path, out)], env=environment, check=True, timeout=120)
    lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    assert [line["samples"] for line in lines] == [8, 16]
    assert load_checkpoint(out / "checkpoint.safetensors")[0].n_corrected


def test_all_weights_of_the_network_learn_and_no_statistics_of_norms(corrected: Path, network_path: Path) -> None:
    before, after = weights(network_path), weights(corrected)
    changed = {name for name in before if not torch.equal(after[name], before[name])}
    assert changed == {name for name in before if name.endswith((".weight", ".bias"))}


def test_a_corrected_network_can_be_trained_further(corrected: Path, shards_dir: Path, tmp_path: Path) -> None:
    """Its maps change, so what corrected their fits is left behind."""
    network = ["--preset", "tiny", "--architecture", "residual", "--size-px", "64", "--filters", "4", "--planes", "7"]
    amount = ["--epochs", "1", "--epoch-size", "4", "--workers", "0"]
    start = ["--init", str(corrected)]
    assert main(["--shards", str(shards_dir), "--out", str(tmp_path / "further"), *network, *amount, *start]) == 0
    header, further = load_checkpoint(tmp_path / "further" / "checkpoint.safetensors")
    assert header.n_corrected == 0
    assert not [name for name in further.state_dict() if name.startswith("correction.")]


def test_fits_become_better(shards_dir: Path, network_path: Path, tmp_path: Path) -> None:
    """The maps of this network say nothing of the face, so what is right is what its features say, and the mean."""
    longer = "--frozen", "--epoch-size", "120", "--learning-rate", "0.003", "--warm-up", "40", "--ema", "0.9"
    assert main(arguments(shards_dir, network_path, tmp_path / "out", *longer)) == 0
    after = weights(tmp_path / "out" / "checkpoint.safetensors")
    assert all(torch.equal(after[name], own) for name, own in weights(network_path).items())  # frozen
    predictor = Predictor.load(tmp_path / "out" / "checkpoint.safetensors", "cpu")
    errors = []
    for path in shard_paths(shards_dir):
        reader = ShardReader(path)
        for sample in (reader.read(index) for index in range(len(reader))):
            prediction = predictor.predict(sample.image, FaceBox.around(sample.landmarks2d))
            fits = [fit_face(prediction.maps, MODEL, FitOptions(correction=own)) for own in (False, True)]
            found = [fit.in_image(prediction.crop).landmarks2d for fit in fits]
            errors.append([np.linalg.norm(points - sample.landmarks2d, axis=1).mean() for points in found])
    uncorrected_px, corrected_px = np.mean(errors, axis=0)
    assert corrected_px < 0.95 * uncorrected_px


def test_networks_that_cannot_be_corrected_are_refused(shards_dir: Path, tmp_path: Path, capsys) -> None:
    paper = tmp_path / "paper"
    small = ["--preset", "tiny", "--size-px", "32", "--filters", "4", "--epochs", "1", "--epoch-size", "4"]
    small += ["--workers", "0", "--architecture", "paper"]
    assert main(["--shards", str(shards_dir), "--out", str(paper), *small]) == 0
    assert main(arguments(shards_dir, paper / "checkpoint.safetensors", tmp_path / "out")) == 2
    assert "expected a network of the architecture residual, found paper" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("planes", "landmarks", "message"),
    [
        (8, 0, "expected the layer seen, which the network predicts, found shards without it; .* or give --frozen"),
        (7, 51, "expected shards with 51 landmarks a sample, found 68; render faces of the model"),
    ],
)
def test_what_the_shards_lack_is_told(
    shards_dir: Path, network_path: Path, tmp_path: Path, capsys, planes: int, landmarks: int, message: str
) -> None:
    header, _ = load_checkpoint(network_path)
    save_checkpoint(
        tmp_path / "network.safetensors",
        replace(header, planes=planes, n_landmarks=landmarks),
        ResidualUNet(header.widths, planes, landmarks).eval(),
    )
    assert main(arguments(shards_dir, tmp_path / "network.safetensors", tmp_path / "out")) == 2
    assert re.search(message, " ".join(capsys.readouterr().err.split()))


def test_a_damaged_sample_is_told(shards_dir: Path, network_path: Path, tmp_path: Path, capsys) -> None:
    copy_with_a_damaged_sample(shards_dir, tmp_path / "shards")
    assert main(arguments(tmp_path / "shards", network_path, tmp_path / "out")) == 2
    assert "shard-000001.h5" in capsys.readouterr().err


def test_the_card_tells_of_the_training(corrected: Path, tmp_path: Path) -> None:
    assert main(["export", str(corrected), "--out", str(tmp_path / "release"), "--no-onnx"]) == 0
    card = (tmp_path / "release" / "README.md").read_text()
    assert "The last training, with the correction of fits, took 16 draws of 5 others (hash: " in card


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--ema", "1", "expected 0 or more and less than 1, found 1.0"),
        ("--epochs", "0", "expected a finite number above 0, found 0"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(
    shards_dir: Path, network_path: Path, tmp_path: Path, capsys, option: str, value: str, message: str
) -> None:
    assert main(arguments(shards_dir, network_path, tmp_path / "out", option, value)) == 2
    assert f"{option}: {message}" in capsys.readouterr().err
