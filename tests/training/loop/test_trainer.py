import json
import math
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from pix2face.errors import InputFileError, Pix2FaceError, UsageError
from pix2face.files.images import encode_image
from pix2face.geometry.jitter import JitterRange
from pix2face.inference import CHECKPOINT_NAME
from pix2face.inference.torch_networks import load_checkpoint
from pix2face.shards.shard_reader import ShardReader
from pix2face.shards.shard_writing import write_shard
from tests.training.random_batches import random_batch
from training.data.shard_index import index_shards
from training.loop.losses import LossPlan
from training.loop.resume import save_state, steps_done
from training.loop.run_configuration import training_configuration
from training.loop.tasks import MapTask, Surroundings
from training.loop.trainer import LOG_NAME, RESUME_NAME, Observers, TrainingStopped, train
from training.recipe.presets import PRESETS
from training.recipe.recipe import Recipe

pytestmark = pytest.mark.xdist_group("trainer")  # the whole training runs once

RECIPE = replace(PRESETS["tiny"], size_px=32, filters=4, batch_size=2, epochs=4, epoch_size=6)
# Batch norm with statistics, a running mean, masks, clipping, a smooth schedule: all the state that there can be.
RESIDUAL = Recipe(
    architecture="residual",
    size_px=64,
    filters=2,
    planes=7,
    batch_size=4,
    parts=2,
    epochs=2,
    epoch_size=24,
    learning_rate=1e-3,
    schedule="cosine",
    warm_up=8,
    precision="bfloat16",
    clip=0.5,
    ema=0.9,
    norm_batches=2,
)
HERE = Surroundings(device="cpu", workers=0, cache_bytes=10**8)
STATE_AFTER_EACH_STEP = replace(HERE, state_minutes=0.0)


def interrupt_at(epoch: int, step: int) -> Observers:
    def on_step(report):
        if (report.epoch, report.step) == (epoch, step):
            raise KeyboardInterrupt

    return Observers(on_step=on_step)


def stop_at(epoch: int, step: int) -> Observers:
    steps = []

    def on_step(report):
        steps.append((report.epoch, report.step))

    return Observers(on_step=on_step, should_stop=lambda: steps[-1] == (epoch, step))


@pytest.fixture(scope="module")
def shards(shards_dir):
    return index_shards([shards_dir])


@pytest.fixture(scope="module")
def trained(shards, tmp_path_factory):
    out = tmp_path_factory.mktemp("trained")
    train(shards, RECIPE, out, HERE)
    return out


@pytest.fixture
def uninterrupted(trained, tmp_path):
    """The checkpoint of a whole training, in a folder that may be written to."""
    return shutil.copytree(trained, tmp_path / "whole") / CHECKPOINT_NAME


def test_an_interrupted_training_ends_bit_for_bit_where_a_whole_one_does(shards, tmp_path, uninterrupted):
    out = tmp_path / "parts"
    for epoch, step in ((0, 2), (2, 3)):
        with pytest.raises(KeyboardInterrupt):
            train(shards, RECIPE, out, HERE, observers=interrupt_at(epoch, step))
    assert steps_done(out / RESUME_NAME, training_configuration(shards, RECIPE)) == 2 * 3
    parts = train(shards, RECIPE, out, HERE)
    assert parts.read_bytes() == uninterrupted.read_bytes()
    assert (out / RESUME_NAME).read_bytes() == (uninterrupted.parent / RESUME_NAME).read_bytes()
    lines = [json.loads(line) for line in (out / LOG_NAME).read_text().splitlines()]
    assert [line["epoch"] for line in lines] == [0, 1, 2, 3]


@pytest.mark.parametrize("recipe", [replace(RECIPE, precision="float32"), RESIDUAL], ids=["paper", "residual"])
def test_it_goes_on_from_any_step_bit_for_bit(shards, tmp_path, recipe):
    whole = train(shards, recipe, tmp_path / "whole", HERE)
    out = tmp_path / "parts"
    step = np.random.default_rng().integers(1, recipe.epoch_steps)  # another one each time: none may matter
    with pytest.raises(KeyboardInterrupt):  # dies while a step is reported; the state of the step before is there
        train(shards, recipe, out, STATE_AFTER_EACH_STEP, observers=interrupt_at(1, int(step)))
    with pytest.raises(TrainingStopped, match="the same command goes on from there"):
        train(shards, recipe, out, HERE, observers=stop_at(1, int(step)))
    done = steps_done(out / RESUME_NAME, training_configuration(shards, recipe))
    assert done == recipe.epoch_steps + step
    assert load_checkpoint(out / CHECKPOINT_NAME)[0].samples == done * recipe.batch_size
    parts = train(shards, recipe, out, HERE)
    assert parts.read_bytes() == whole.read_bytes()
    assert (out / RESUME_NAME).read_bytes() == (tmp_path / "whole" / RESUME_NAME).read_bytes()


def test_the_configuration_tells_weights_of_losses_and_of_sets(shards):
    configuration = json.loads(training_configuration(shards, RECIPE))
    assert (configuration["weights"]["offset"], configuration["mixture"]) == (RECIPE.weights.offset, [1.0])
    other = replace(RECIPE, weights=replace(RECIPE.weights, offset=2.0))
    assert training_configuration(shards, other) != training_configuration(shards, RECIPE)


def test_the_test_above_can_fail(shards, tmp_path, uninterrupted):
    other = train(shards, replace(RECIPE, seed=1), tmp_path / "other", HERE)
    assert not torch.equal(*(load_file(path)["decoder.4.weight"] for path in (uninterrupted, other)))


def test_a_finished_training_is_left_alone(shards, uninterrupted):
    before = uninterrupted.read_bytes()
    assert train(shards, RECIPE, uninterrupted.parent, HERE, observers=interrupt_at(0, 1)) == uninterrupted
    assert uninterrupted.read_bytes() == before


def test_an_interruption_keeps_the_last_epochs_checkpoint(shards, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        train(shards, RECIPE, tmp_path, HERE, observers=interrupt_at(1, 2))
    header, _ = load_checkpoint(tmp_path / CHECKPOINT_NAME)
    assert header.epoch == 1


def test_the_checkpoint_says_what_it_was_trained_on(shards, uninterrupted):
    header, _ = load_checkpoint(uninterrupted)
    assert (header.size_px, header.widths[0], header.epoch, header.samples) == (32, 4, 4, 24)
    assert (header.model_name, header.model_sha256) == (shards.model_name, shards.model_sha256)
    assert (header.pncc_scale_mm, header.offset_scale_mm) == (shards.pncc_scale_mm, shards.offset_scale_mm)
    assert header.licence == shards.licence
    assert json.loads(header.configuration)["epoch_size"] == 6


def test_a_network_learns_its_samples(shards, tmp_path):
    still = JitterRange(scale=(1.4, 1.4), shift=0.0, rotation_deg=0.0)
    recipe = replace(RECIPE, filters=8, epoch_size=125, batch_size=5, learning_rate=2e-3, jitter=still)
    train(shards, recipe, tmp_path, HERE)
    losses = [json.loads(line)["loss"] for line in (tmp_path / LOG_NAME).read_text().splitlines()]
    assert losses[-1] < 0.6 * losses[0]


def test_the_log_names_its_parts(shards, uninterrupted):
    lines = [json.loads(line) for line in (uninterrupted.parent / LOG_NAME).read_text().splitlines()]
    for line in lines:
        assert line["loss"] == pytest.approx((line["pncc"] + line["offset"]) / 2, abs=1e-6)
        assert line["images_per_second"] > 0
        assert 0 <= line["waiting"] <= 1
        assert line["memory_mb"] > 10
    assert lines[0]["learning_rate"] == 1e-3
    assert lines[-1]["learning_rate"] == pytest.approx(2.1e-5)


def test_another_configuration_is_refused_and_the_difference_named(shards, uninterrupted):
    with pytest.raises(UsageError, match=r"another configuration \(epochs 4 -> 5; seed 0 -> 3\); .*--restart"):
        train(shards, replace(RECIPE, epochs=5, seed=3), uninterrupted.parent, HERE)


def test_a_longer_training_is_told_how_to_go_on(shards, uninterrupted):
    with pytest.raises(UsageError, match=r"\(epochs 4 -> 5\); .*give its checkpoint as --init, and another --out"):
        train(shards, replace(RECIPE, epochs=5), uninterrupted.parent, HERE)
    with pytest.raises(UsageError) as caught:
        train(shards, replace(RECIPE, epochs=5, seed=3), uninterrupted.parent, HERE)
    assert "--init" not in str(caught.value)


def test_other_samples_are_refused(shards, shards_dir, uninterrupted):
    with pytest.raises(UsageError, match=r"samples 5 -> 10; samples_sha256 "):
        train(index_shards([shards_dir, shards_dir]), RECIPE, uninterrupted.parent, HERE)


def test_samples_of_the_same_ids_with_other_pictures_are_refused(shards_dir, tmp_path, uninterrupted):
    shutil.copytree(shards_dir, tmp_path / "again")
    path = tmp_path / "again" / "shard-000001.h5"
    reader = ShardReader(path)
    header, triplets = reader.header, [reader.read(index) for index in range(len(reader))]
    write_shard(path, header, triplets)
    train(index_shards([tmp_path / "again"]), RECIPE, uninterrupted.parent, HERE)  # the same content goes on
    repainted = replace(triplets[0], image_bytes=encode_image(np.zeros((*triplets[0].maps.mask.shape, 3), np.uint8)))
    write_shard(path, header, [repainted, *triplets[1:]])
    with pytest.raises(UsageError, match=r"another configuration \(samples_sha256 "):
        train(index_shards([tmp_path / "again"]), RECIPE, uninterrupted.parent, HERE)


def test_a_cut_state_is_refused(shards, uninterrupted):
    path = uninterrupted.parent / RESUME_NAME
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(InputFileError, match=r"resume\.safetensors"):
        train(shards, RECIPE, uninterrupted.parent, HERE)


@pytest.mark.filterwarnings("ignore:overflow encountered")
def test_a_diverging_training_stops_and_keeps_the_last_checkpoint(shards, tmp_path, monkeypatch):
    with pytest.raises(KeyboardInterrupt):
        train(shards, RECIPE, tmp_path, HERE, observers=interrupt_at(1, 1))
    before = (tmp_path / CHECKPOINT_NAME).read_bytes()

    monkeypatch.setattr(LossPlan, "total", lambda plan, parts: parts["pncc"] * math.inf)
    with pytest.raises(Pix2FaceError, match=r"epoch 2, step 1: the loss is (-?inf|nan)\. The checkpoint .* is kept"):
        train(shards, RECIPE, tmp_path, HERE)
    assert (tmp_path / CHECKPOINT_NAME).read_bytes() == before


def test_weights_that_the_last_step_ruined_are_not_saved(shards, tmp_path):
    recipe = replace(RECIPE, learning_rate=1e300, epoch_size=2)
    with pytest.raises(Pix2FaceError, match="the weights are not finite"):
        train(shards, recipe, tmp_path, HERE)
    assert not (tmp_path / CHECKPOINT_NAME).exists()


def test_a_sample_that_cannot_be_read_ends_in_one_line(shards_dir, tmp_path):
    shutil.copytree(shards_dir, tmp_path / "shards")
    shards = index_shards([tmp_path / "shards"])
    path = tmp_path / "shards" / "shard-000001.h5"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(InputFileError, match=r"shard-000001\.h5") as caught:
        train(shards, RECIPE, tmp_path / "out", HERE)
    assert "\n" not in str(caught.value)
    assert not str(caught.value).startswith("pix2face.errors")


def test_norms_are_measured_at_the_end_alone_and_only_where_they_are_asked_for(shards, tmp_path):
    def tensors(n):
        recipe = replace(RESIDUAL, epoch_size=8, norm_batches=n)
        return load_checkpoint(train(shards, recipe, tmp_path / str(n), HERE))[1].state_dict()

    measured, left = tensors(2), tensors(0)
    counts = [name for name in left if name.endswith("num_batches_tracked")]
    assert all(int(left[name]) > 2 for name in counts)
    assert all(int(measured[name]) == 2 for name in counts)
    for name, value in left.items():
        assert torch.equal(value, measured[name]) != ("running" in name or name in counts)


def test_a_state_of_before_norms_were_measured_is_gone_on_from(shards, tmp_path):
    recipe, path = replace(RESIDUAL, norm_batches=0), tmp_path / RESUME_NAME
    learner = MapTask(shards, recipe).new_learner(HERE)
    learner.step(random_batch(recipe))
    earlier = json.loads(training_configuration(shards, recipe))
    assert earlier.pop("norm_batches") == 0
    save_state(path, learner, json.dumps(earlier))
    assert steps_done(path, training_configuration(shards, recipe)) == 1
    with pytest.raises(UsageError, match="norm_batches 0 -> 9"):
        steps_done(path, training_configuration(shards, replace(recipe, norm_batches=9)))
