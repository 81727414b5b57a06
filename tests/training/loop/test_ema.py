import pytest
import torch
from torch import nn

from training.loop.learner import STEPS_BETWEEN, RunningMean


def network_of(value: float) -> nn.Module:
    network = nn.Sequential(nn.Conv2d(1, 1, 1), nn.BatchNorm2d(1))
    with torch.no_grad():
        for tensor in network.state_dict().values():
            tensor.fill_(value)
    return network


def follow(mean: RunningMean, values: list[float]) -> list[float]:
    found = []
    for step, value in enumerate(values, start=1):
        mean.follow(network_of(value), step)
        found.append(float(mean.network.state_dict()["0.weight"]))
    return found


def test_it_is_the_running_mean_of_every_fourth_step():
    values = [float(step) for step in range(1, 401)]
    found = follow(RunningMean(network_of(0.0), 0.9), values)
    expected, means = 0.0, []
    for step, value in enumerate(values, start=1):
        if step % STEPS_BETWEEN == 0:
            decay = min(0.9, (1 + step) / (10 + step)) ** STEPS_BETWEEN
            expected = decay * expected + (1 - decay) * value
        means.append(expected)
    assert found == pytest.approx(means, rel=1e-5)


def test_of_a_line_it_lags_as_the_mean_of_every_step_would():
    values = [float(step) for step in range(1, 801)]
    found = follow(RunningMean(network_of(0.0), 0.98), values)[-1]
    # sum over k of (1 - d) d^k (t - k) = t - d / (1 - d)
    assert found == pytest.approx(800 - 0.98 / 0.02, abs=STEPS_BETWEEN)


def test_the_first_weights_do_not_linger():
    assert follow(RunningMean(network_of(1000.0), 0.9999), [0.0] * 40)[-1] < 20


def test_statistics_follow_and_counts_are_copied():
    mean = RunningMean(network_of(0.0), 0.9)
    mean.follow(network_of(8.0), STEPS_BETWEEN)
    state = mean.network.state_dict()
    assert 0 < float(state["1.running_mean"]) < 8
    assert int(state["1.num_batches_tracked"]) == 8


def test_it_neither_learns_nor_drives_its_norms():
    mean = RunningMean(network_of(1.0), 0.9)
    assert not mean.network.training
    assert not any(parameter.requires_grad for parameter in mean.network.parameters())
