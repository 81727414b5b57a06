import json
import re
from dataclasses import asdict, replace

import pytest
import tyro

from pix2face.errors import InputFileError, UsageError
from training.loop.processes import Processes
from training.recipe.presets import PRESETS
from training.train_cli import surroundings_of
from training.train_config import TrainConfig, defaults_of


def recipe_of(*arguments: object):
    return parsed(*arguments).recipe()


def parsed(*arguments: object) -> TrainConfig:
    words = [str(argument) for argument in arguments]
    return tyro.cli(TrainConfig, default=defaults_of(words), args=words)


def test_a_length_in_samples_becomes_epochs_of_the_same_size():
    recipe = recipe_of("--preset", "tiny", "--samples", 10_000)
    assert (recipe.epochs, recipe.epoch_size) == (4, 2500)
    assert recipe.steps * recipe.batch_size == 4 * 2504  # whole batches
    assert recipe_of("--preset", "tiny", "--samples", 10).epochs == 1
    with pytest.raises(UsageError, match="--samples: expected it or --epochs, found both"):
        recipe_of("--samples", 10, "--epochs", 2)
    with pytest.raises(UsageError, match="--samples: expected more than 0, found 0"):
        recipe_of("--samples", 0)


def test_each_loss_has_its_weight():
    weights = recipe_of("--preset", "cpu", "--weight-offset", 7, "--weight-seen", 0).weights
    assert (weights.pncc, weights.offset, weights.mask, weights.seen) == (1, 7, 0.2, 0)


@pytest.mark.parametrize(("given", "mirrored"), [((), True), (("--mirror", "yes"), True), (("--mirror", "no"), False)])
def test_mirroring_can_be_taken_from_a_preset(given, mirrored):
    assert recipe_of("--preset=cpu", *given).jitter.mirror is mirrored


def test_another_architecture_has_widths_of_its_own():
    assert recipe_of("--architecture", "residual", "--size-px", 192, "--filters", 16).widths == (
        16,
        32,
        64,
        96,
        128,
        128,
    )


@pytest.mark.parametrize("name", ["cache_gb", "workers", "state_minutes"])
def test_surroundings_that_make_no_sense_are_refused(name):
    config = TrainConfig(**{name: -1})
    with pytest.raises(UsageError, match=f"--{name.replace('_', '-')}: expected 0 or more"):
        surroundings_of(config, Processes())


def test_help_and_recipe_start_from_the_preset(capsys):
    assert recipe_of() == PRESETS["paper"]
    for name, preset in PRESETS.items():
        assert recipe_of("--preset", name) == preset
        changed = recipe_of("--seed", 7, f"--preset={name}", "--filters", 8)
        assert changed == replace(preset, seed=7, filters=8)
        with pytest.raises(SystemExit):
            parsed("--preset", name, "--help")
        shown = " ".join(capsys.readouterr().out.replace("│", " ").split())
        assert (
            f"Number of pictures per step, for all parts and processes together. (default: {preset.batch_size})"
            in shown
        )


def test_the_configuration_of_a_training_keeps_its_form():
    """A state that was written before is gone on from only where all of this is the same."""
    jitter = {"scale": [1.0, 1.8], "shift": 0.25, "rotation_deg": 20.0, "gamma": [0.8, 1.2], "gain": 0.8}
    weights = {"pncc": 1.0, "offset": 1.0, "linear": 0.0, "mask": 2.0, "seen": 1.0, "scale": 0.02, "landmarks": 0.02}
    assert json.loads(json.dumps(asdict(recipe_of("--preset", "tiny", "--mirror", "yes", "--weight-mask", 2)))) == {
        "architecture": "paper",
        "size_px": 64,
        "filters": 16,
        "planes": 6,
        "n_landmarks": 0,
        "batch_size": 8,
        "parts": 1,
        "epochs": 6,
        "epoch_size": 3000,
        "learning_rate": 0.001,
        "schedule": "paper",
        "warm_up": 0,
        "precision": "bfloat16",
        "weights": weights,
        "loss_over": "all",
        "clip": 0.0,
        "ema": 0.0,
        "norm_batches": 0,
        "seed": 0,
        "jitter": jitter | {"contrast": [1.0, 1.0], "mirror": True},
        "cropping": "full",
        "crop_scale": 1.4,
    }


def test_a_file_of_options_is_what_was_written(tmp_path):
    file = tmp_path / "configuration.json"
    given = parsed(
        "--preset", "cpu", "--shards", "a:0.7", "b", "--init", "a.safetensors", "--mirror", "no", "--samples", 9
    )
    file.write_text(given.as_json())
    assert replace(parsed("--config", file), config=None) == given
    changed = parsed(f"--config={file}", "--weight-offset", 7, "--out", "runs/again", "--shards", "c")
    assert changed.recipe() == replace(given.recipe(), weights=replace(given.numbers.weights, offset=7.0))
    assert (str(changed.out), changed.shards, changed.preset) == ("runs/again", ("c",), "cpu")


def test_a_file_may_say_little(tmp_path):
    file = tmp_path / "little.json"
    file.write_text(json.dumps({"preset": "cpu", "weights": {"mask": 1}, "jitter": {"gamma": [0.5, 2]}}))
    numbers = parsed("--config", file).numbers
    of_preset = PRESETS["cpu"]
    jitter = replace(of_preset.jitter, gamma=(0.5, 2.0))
    assert numbers == replace(of_preset, weights=replace(of_preset.weights, mask=1.0), jitter=jitter)


@pytest.mark.parametrize(
    ("content", "found"),
    [
        ({"seed": 1, "sede": 2, "jitter": {"gama": 1}}, "unknown ones: sede, jitter.gama"),
        ({"dry_run": True}, "unknown ones: dry_run"),
        ({"seed": "one"}, "Expected `int`, got `str` - at `$.numbers.seed`"),
        ({"init": 3}, "Expected `str`, got `int`"),
        ({"jitter": 3}, "Expected `object`, got `int`"),
        ({"preset": "huge"}, "Invalid enum value 'huge'"),
        ([], "Expected `object`, got `array`"),
    ],
)
def test_a_file_that_is_wrong_says_where(content, found, tmp_path):
    file = tmp_path / "wrong.json"
    file.write_text(json.dumps(content))
    with pytest.raises(InputFileError, match=re.escape(found)):
        TrainConfig.of_file(file)


def test_calls_that_start_from_two_places_are_refused(tmp_path):
    with pytest.raises(UsageError, match="expected --config or --preset, found both"):
        defaults_of(["--config", "a.json", "--preset", "cpu"])
    with pytest.raises(UsageError, match="the same command with the same --out continues"):
        defaults_of(["--resume"])
