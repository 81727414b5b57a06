from dataclasses import replace

import pytest
import torch

from pix2face.errors import Pix2FaceError
from tests.training.random_batches import random_batch
from training.data.batches import as_input
from training.loop.learner import Learner
from training.loop.losses import LossPlan
from training.recipe.presets import PRESETS
from training.recipe.recipe import Recipe

RECIPE = replace(PRESETS["tiny"], size_px=16, filters=4, batch_size=4, precision="float32", epochs=2, epoch_size=16)
PLAN = LossPlan(pncc_scale_mm=8.0, offset_scale_mm=8.0, weights=RECIPE.weights, over="all")


def new_learner(recipe: Recipe) -> Learner:
    return Learner(recipe, recipe.new_network, PLAN, "cpu")


def weights(learner: Learner) -> torch.Tensor:
    return torch.cat([parameter.detach().flatten() for parameter in learner.network.parameters()])


def trained(recipe, steps: int = 3) -> tuple[Learner, list[float]]:
    learner = new_learner(recipe)
    return learner, [learner.step(random_batch(recipe, seed)).total for seed in range(steps)]


def gradient(learner: Learner) -> torch.Tensor:
    return torch.cat([parameter.grad.flatten() for parameter in learner.network.parameters()])


def test_parts_of_a_batch_give_loss_and_gradient_of_the_whole():
    # Not the weights: where a gradient is 0 but for rounding (biases before a norm), Adam makes full steps of noise.
    whole, losses = trained(RECIPE, 1)
    for parts in (2, 4):
        divided, same_losses = trained(replace(RECIPE, parts=parts), 1)
        assert same_losses == pytest.approx(losses, rel=1e-6)
        torch.testing.assert_close(gradient(divided), gradient(whole), rtol=1e-4, atol=1e-7)
    smaller = trained(replace(RECIPE, batch_size=2), 1)[0]
    assert not torch.allclose(gradient(smaller), gradient(whole), rtol=1e-2, atol=1e-5)


def test_parts_of_a_batch_go_on_with_the_losses_of_the_whole():
    assert trained(replace(RECIPE, parts=2), 8)[1] == pytest.approx(trained(RECIPE, 8)[1], rel=1e-3)


def test_a_long_gradient_is_shortened_and_a_short_one_left():
    free = trained(RECIPE, 1)[0]
    norm = float(gradient(free).norm())
    assert gradient(trained(replace(RECIPE, clip=norm / 3), 1)[0]).norm().item() == pytest.approx(norm / 3, rel=1e-3)
    assert gradient(trained(replace(RECIPE, clip=norm * 3), 1)[0]).norm().item() == pytest.approx(norm, rel=1e-6)


def test_the_rate_is_the_schedules():
    steps = [new_learner(RECIPE).step(random_batch(RECIPE)).learning_rate]
    assert steps == [1e-3]
    learner, recipe = trained(replace(RECIPE, schedule="linear", warm_up=8), 0)[0], RECIPE
    rates = [learner.step(random_batch(recipe)).learning_rate for _ in range(8)]
    assert rates == pytest.approx(
        [1e-3 * fraction for fraction in (1 / 3, 2 / 3, 1, 5 / 6, 4 / 6, 3 / 6, 2 / 6, 1 / 6)]
    )


def test_a_gradient_that_is_not_finite_is_told_where_it_is_looked_at():
    learner = new_learner(replace(RECIPE, clip=1.0))
    next(learner.network.parameters()).register_hook(lambda gradient: gradient * float("nan"))
    with pytest.raises(Pix2FaceError, match=r"epoch 1, step 1: the gradient's norm is nan\..*--learning-rate"):
        learner.step(random_batch(RECIPE))


def test_a_start_takes_over_weights_and_their_mean():
    source = trained(replace(RECIPE, ema=0.9), 5)[0]
    learner = new_learner(replace(RECIPE, ema=0.9))
    learner.start_from(source.result)
    for found in (learner.network, learner.result):
        for own, expected in zip(found.state_dict().values(), source.result.state_dict().values(), strict=True):
            assert torch.equal(own, expected)


def test_without_a_running_mean_the_result_is_the_network():
    learner = trained(RECIPE, 1)[0]
    assert learner.result is learner.network


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_the_seed_decides_everything(precision):
    recipe = replace(RECIPE, precision=precision)
    same = [weights(trained(recipe)[0]) for _ in range(2)]
    assert torch.equal(*same)
    assert not torch.equal(same[0], weights(trained(replace(recipe, seed=1))[0]))


@pytest.mark.parametrize("has_bfloat16", [True, False])
def test_bfloat16_is_used_only_where_the_processor_computes_in_it(has_bfloat16, monkeypatch):
    monkeypatch.setattr("training.loop.learner.has_bfloat16", lambda: has_bfloat16)
    rounded, exact = (
        weights(trained(replace(RECIPE, precision=precision))[0]) for precision in ("bfloat16", "float32")
    )
    assert torch.equal(rounded, exact) != has_bfloat16


def test_norms_are_measured_with_the_weights_that_the_checkpoint_holds():
    recipe = replace(
        RECIPE, architecture="residual", size_px=64, filters=4, ema=0.9, precision="bfloat16", learning_rate=0.1
    )
    learner = trained(recipe, 6)[0]
    before = {name: value.clone() for name, value in learner.result.state_dict().items()}
    batches = [random_batch(recipe, seed) for seed in (70, 71, 72)]
    learner.measure_norms(iter(batches))
    after, norm = learner.result.state_dict(), learner.result.stem_norm
    with torch.no_grad():
        planes = learner.result.stem(torch.cat([as_input(batch.image) for batch in batches]))
    torch.testing.assert_close(norm.running_mean, planes.mean(dim=(0, 2, 3)), rtol=1e-4, atol=1e-5)
    assert not torch.allclose(norm.running_mean, before["stem_norm.running_mean"], rtol=1e-2)
    of_weights = [name for name in before if "running" not in name and "num_batches" not in name]
    assert all(torch.equal(before[name], after[name]) for name in of_weights)
    assert not learner.result.training
    assert (norm.momentum, learner.network.stem_norm.momentum) == (0.1, 0.1)
    learner.measure_norms(iter(()))
    assert all(torch.equal(value, learner.result.state_dict()[name]) for name, value in after.items())


def test_only_batch_norms_have_anything_to_measure():
    assert not new_learner(RECIPE).has_batch_norms
    assert new_learner(replace(RECIPE, architecture="residual", size_px=64)).has_batch_norms
