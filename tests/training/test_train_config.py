import pytest

from pix2face.errors import UsageError
from training.loop.processes import Processes
from training.train_config import TrainConfig


def recipe_of(**options):
    return TrainConfig(shards=("shards",), **options).recipe()


def test_a_length_in_samples_becomes_epochs_of_the_same_size():
    recipe = recipe_of(preset="tiny", samples=10_000)
    assert (recipe.epochs, recipe.epoch_size) == (4, 2500)
    assert recipe.steps * recipe.batch_size == 4 * 2504  # whole batches
    assert recipe_of(preset="tiny", samples=10).epochs == 1
    with pytest.raises(UsageError, match="--samples: expected it or --epochs, found both"):
        recipe_of(samples=10, epochs=2)
    with pytest.raises(UsageError, match="--samples: expected more than 0, found 0"):
        recipe_of(samples=0)


def test_each_loss_has_its_weight():
    weights = recipe_of(preset="cpu", weight_offset=7, weight_seen=0).weights
    assert (weights.pncc, weights.offset, weights.mask, weights.seen) == (1, 7, 0.2, 0)


@pytest.mark.parametrize(("given", "mirrored"), [(None, True), ("yes", True), ("no", False)])
def test_mirroring_can_be_taken_from_a_preset(given, mirrored):
    assert recipe_of(preset="cpu", mirror=given).jitter.mirror is mirrored


def test_another_architecture_has_widths_of_its_own():
    assert recipe_of(architecture="residual", size_px=192, filters=16).widths == (16, 32, 64, 96, 128, 128)


@pytest.mark.parametrize("name", ["cache_gb", "workers", "state_minutes"])
def test_surroundings_that_make_no_sense_are_refused(name):
    config = TrainConfig(shards=("shards",), **{name: -1})
    with pytest.raises(UsageError, match=f"--{name.replace('_', '-')}: expected 0 or more"):
        config.surroundings(Processes())
