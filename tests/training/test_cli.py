import json
import shutil
from dataclasses import replace

import pytest
import torch

from pix2face.inference.torch_networks import load_checkpoint
from pix2face.models.morphable_model import builtin_model
from pix2face.shards.shard_writing import write_shard
from tests.synthetic_models import small_head_model
from tests.training.conftest import head_triplet, shard_header
from training.cli import main
from training.data.shard_index import index_shards
from training.loop.plan_report import duration_in_words, summary
from training.recipe.presets import PRESETS
from training.train_cli import next_command

pytestmark = pytest.mark.xdist_group("train")  # the network is trained once

SMALL = ["--preset", "tiny", "--size-px", "32", "--filters", "4"]
SMALL += ["--epochs", "2", "--epoch-size", "4", "--workers", "0"]


def test_from_shards_to_a_checkpoint(shards_dir, tmp_path, capsys):
    arguments = ["--shards", str(shards_dir), "--out", str(tmp_path / "run"), *SMALL]
    assert main(arguments) == 0
    header, _ = load_checkpoint(tmp_path / "run" / "checkpoint.safetensors")
    assert header.epoch == 2
    said = capsys.readouterr().err
    assert "5 in 2 shards" in said
    assert "2 epochs of 4 pictures" in said
    assert "next: evaluate --help" in said
    assert main(arguments) == 0
    assert ", 16 pictures done" in capsys.readouterr().err
    assert main(["--config", str(tmp_path / "run" / "configuration.json")]) == 0
    assert ", 16 pictures done" in capsys.readouterr().err
    assert main(["--config", str(tmp_path / "run" / "configuration.json"), "--out", str(tmp_path / "again")]) == 0
    first, again = (load_checkpoint(tmp_path / name / "checkpoint.safetensors")[1] for name in ("run", "again"))
    for own, other in zip(first.parameters(), again.parameters(), strict=True):
        assert torch.equal(own, other)


def test_the_next_command_is_the_benchmark_of_the_faces_trained_on(shards_dir, tmp_path):
    builtin, checkpoint = builtin_model(), tmp_path / "checkpoint.safetensors"
    of_head = index_shards([shards_dir])
    of_renders = replace(of_head, model_sha256=builtin.sha256, licence=builtin.licence)
    of_photographs = replace(of_renders, licence=f"pictures: research use only; model: {builtin.licence}")
    command = f"evaluate --split builtin-heldout --data HELDOUT --checkpoint {checkpoint} "
    assert next_command(of_renders, checkpoint).startswith(command)
    for shards in (of_head, of_photographs):
        assert next_command(shards, checkpoint).startswith("evaluate --help")


@pytest.mark.parametrize(
    ("has_bfloat16", "device", "computed"),
    [(True, "cpu", "bfloat16"), (False, "cpu", "float32"), (False, "cuda:1", "bfloat16")],
)
def test_the_summary_names_the_arithmetic_that_is_computed(has_bfloat16, device, computed, shards_dir, monkeypatch):
    monkeypatch.setattr("training.loop.learner.has_bfloat16", lambda: has_bfloat16)
    said = summary(index_shards([shards_dir]), PRESETS["tiny"], "tiny", device, shards_dir / "run", 0).plain
    assert f"batches of {PRESETS['tiny'].batch_size}, {computed}\n" in said


def test_restart_replaces_a_training_and_one_of_another_size_does_not_go_on_from_it(shards_dir, tmp_path, capsys):
    arguments = ["--shards", str(shards_dir), *SMALL]
    out = ["--out", str(tmp_path / "run")]
    assert main([*arguments, *out]) == 0
    start = ["--init", str(tmp_path / "run" / "checkpoint.safetensors"), "--out", str(tmp_path / "next")]
    assert main([*arguments, "--size-px", "64", *start]) == 2
    assert "--init: expected a network" in capsys.readouterr().err
    assert main([*arguments, *out, "--seed", "1"]) == 2
    assert "seed 0 -> 1" in capsys.readouterr().err
    assert main([*arguments, *out, "--seed", "1", "--restart"]) == 0


def residual(shards_dir, out, *more: str) -> list[str]:
    network = ["--architecture", "residual", "--filters", "2", "--planes", "7", "--size-px", "64"]
    length = ["--epochs", "2", "--epoch-size", "4", "--batch-size", "4", "--workers", "0"]
    return ["--shards", str(shards_dir), "--out", str(out), "--preset", "tiny", *network, *length, *more]


def test_a_dry_run_says_what_a_training_takes_and_writes_nothing(shards_dir, tmp_path, capsys):
    assert main(residual(shards_dir, tmp_path / "run", "--dry-run")) == 0
    said = capsys.readouterr().err
    for expected in (
        "residual 2-4-8-12-16-16, 7 planes",
        "pictures a second",
        "for 2 steps (8 pictures)",
        "MB",
        "mask 0.",
    ):
        assert expected in said
    assert not (tmp_path / "run").exists()


@pytest.fixture(scope="module")
def trained(shards_dir, tmp_path_factory):
    """The checkpoint of a residual network."""
    out = tmp_path_factory.mktemp("trained")
    assert main(residual(shards_dir, out)) == 0
    return out / "checkpoint.safetensors"


def test_a_training_goes_on_at_another_size(trained, shards_dir, tmp_path, capsys):
    second = tmp_path / "128"
    start = ["--init", str(trained)]
    assert main([*residual(shards_dir, second, *start), "--size-px", "128", "--learning-rate", "1e-12"]) == 0
    header, network = load_checkpoint(second / "checkpoint.safetensors")
    assert header.size_px == 128
    assert "initial_sha256" in header.configuration
    before = load_checkpoint(trained)[1].state_dict()
    for name, tensor in network.state_dict().items():  # at so small a rate the weights are the start's
        if "norm" not in name:
            torch.testing.assert_close(tensor, before[name], rtol=1e-4, atol=1e-7)
    capsys.readouterr()
    assert main([*residual(shards_dir, tmp_path / "other", *start), "--planes", "6"]) == 2
    assert "--init: expected a network residual 2-4-8-12-16-16 with 6 planes, 0 landmarks" in capsys.readouterr().err


def test_a_training_goes_on_with_landmarks_added(trained, shards_dir, tmp_path):
    second = tmp_path / "landmarks"
    start = ["--init", str(trained), "--n-landmarks", "68", "--learning-rate", "1e-12"]
    assert main(residual(shards_dir, second, *start, "--validation", "0.5")) == 0
    header, network = load_checkpoint(second / "checkpoint.safetensors")
    assert header.n_landmarks == 68
    before = load_checkpoint(trained)[1].state_dict()
    after = network.state_dict()
    torch.testing.assert_close(after["planes.weight"], before["planes.weight"], rtol=1e-4, atol=1e-7)
    lines = [json.loads(line) for line in (second / "log.jsonl").read_text().splitlines()]
    assert all("landmarks" in line or "validation" in line for line in lines)
    assert 0 < next(line["validation"]["landmark_nme"] for line in lines if "validation" in line) <= 1


def test_validation_finds_the_best_and_tells_the_log(shards_dir, tmp_path):
    out = tmp_path / "run"
    assert main(residual(shards_dir, out, "--validation", "0.5", "--tensorboard", "--cache-gb", "0.01")) == 0
    lines = [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]
    found = [line["validation"] for line in lines if "validation" in line]
    assert len(found) == 2
    assert all(0 <= own["mask_iou"] <= 1 and own["pncc_mm"] > 0 for own in found)
    best = min(range(2), key=lambda epoch: found[epoch]["pncc_mm"])
    assert load_checkpoint(out / "best.safetensors")[0].epoch == best + 1
    assert list((out / "tensorboard").iterdir())


def test_planes_that_the_shards_do_not_know_are_refused(shards_dir, tmp_path, capsys):
    assert main(residual(shards_dir, tmp_path / "run", "--planes", "8")) == 2
    assert "--planes 8, --loss-over seen: expected shards with the layer seen" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "--shards: expected folders of shards, found none"),
        (["--shards", "missing"], "missing: expected a folder of shards, found no such folder"),
        (["--shards", "missing", "--size-px", "200"], "--size-px: expected a power of two"),
        (["--shards", "missing", "--workers", "-1"], "--workers: expected 0 or more, found -1"),
        (["--shards", "missing", "--cache-gb", "nan"], "--cache-gb: expected 0 or more (in 10^9 bytes), found nan"),
        (["--shards", "missing", "--cache-gb", "inf"], "--cache-gb: expected 0 or more (in 10^9 bytes), found inf"),
        (["--shards", "missing", "--cache-gb", "-1"], "--cache-gb: expected 0 or more (in 10^9 bytes), found -1"),
        (["--shards", "missing", "--seed", str(2**63)], "--seed: expected 0 to "),
        (["--shards", "missing", "--device", "meta"], "--device meta: "),
        (["--shards", "missing", "--device", "nonsense"], "--device nonsense: "),
        (["--shards", "missing", "--device", "cuda:9"], "--device cuda:9: "),
    ],
)
def test_a_wrong_call_is_one_line(arguments, message, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert said.startswith("train: error: ")
    assert message in said
    assert said.count("\n") == 1


def test_a_file_in_the_way_of_the_output_is_one_line(shards_dir, tmp_path, capsys):
    (tmp_path / "run").write_bytes(b"kept")
    assert main(["--shards", str(shards_dir), "--out", str(tmp_path / "run"), *SMALL]) == 2
    said = capsys.readouterr().err
    assert "expected a folder that can be written to" in said
    assert said.count("\n") == 1
    assert (tmp_path / "run").read_bytes() == b"kept"


def test_mirroring_is_refused_where_the_model_is_not_symmetric(tmp_path, capsys):
    model, folder = small_head_model(), tmp_path / "shards"
    header = shard_header(model, mirror_obstacle="the mean face of test is not symmetric")
    write_shard(folder / "shard-00000.h5", header, [head_triplet(model, 0)])
    assert main(["--shards", str(folder), "--preset", "tiny", "--mirror", "yes", "--out", str(tmp_path / "run")]) == 2
    assert "--mirror yes: expected shards whose samples can be mirrored, but the mean face" in capsys.readouterr().err
    assert not (tmp_path / "run").exists()


def test_a_shard_cut_in_half_is_one_line(shards_dir, tmp_path, capsys):
    shutil.copytree(shards_dir, tmp_path / "shards")
    path = tmp_path / "shards" / "shard-000000.h5"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert main(["--shards", str(tmp_path / "shards"), "--out", str(tmp_path / "run"), *SMALL]) == 2
    said = capsys.readouterr().err
    assert "shard-000000.h5: expected a complete shard" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0, "0 seconds"),
        (1.2, "1 second"),
        (119, "119 seconds"),
        (130, "2 minutes"),
        (7300, "2 hours"),
        (1e6, "12 days"),
    ],
)
def test_durations_are_in_words(seconds, words):
    assert duration_in_words(seconds) == words
