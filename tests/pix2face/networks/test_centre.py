"""The network that finds faces."""

import copy

import pytest
import torch

from pix2face.networks.centre import PLANES, RARE_LOGIT, STRIDE, CentreNetwork, folded


def test_each_cell_has_an_answer_and_there_are_few_weights() -> None:
    network = CentreNetwork()
    assert network(torch.zeros(2, 3, 64, 96)).shape == (2, PLANES, 64 // STRIDE, 96 // STRIDE)
    assert sum(parameter.numel() for parameter in network.parameters()) < 1_000_000


def test_nothing_is_found_before_training() -> None:
    planes = CentreNetwork().eval()(torch.rand(1, 3, 64, 64) - 0.5)
    assert planes[:, 0].max() < RARE_LOGIT + 1


def test_folding_the_norms_changes_nothing_but_the_norms() -> None:
    torch.manual_seed(0)
    network = CentreNetwork()
    for _ in range(2):  # norms that are not those of the start
        network.train()(torch.rand(2, 3, 64, 64))
    network.eval()
    ready = folded(copy.deepcopy(network))
    assert not any(isinstance(module, torch.nn.BatchNorm2d) for module in ready.modules())
    pictures = torch.rand(1, 3, 64, 64) - 0.5
    torch.testing.assert_close(ready(pictures), network(pictures), atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("size", [(33, 32), (48, 32)])
def test_other_sizes_fail_loudly(size: tuple[int, int]) -> None:
    with pytest.raises(RuntimeError):
        CentreNetwork()(torch.zeros(1, 3, *size))
