"""The network that finds faces."""

import pytest
import torch

from pix2face.networks.dimensions import CENTRE_PLANES, CENTRE_STRIDE
from training.detection.centre_network import RARE_LOGIT, CentreNetwork


def test_each_cell_has_an_answer_and_there_are_few_weights() -> None:
    network = CentreNetwork()
    assert network(torch.zeros(2, 3, 64, 96)).shape == (2, CENTRE_PLANES, 64 // CENTRE_STRIDE, 96 // CENTRE_STRIDE)
    assert sum(parameter.numel() for parameter in network.parameters()) < 1_000_000


def test_nothing_is_found_before_training() -> None:
    planes = CentreNetwork().eval()(torch.rand(1, 3, 64, 64) - 0.5)
    assert planes[:, 0].max() < RARE_LOGIT + 1


@pytest.mark.parametrize("size", [(33, 32), (48, 32)])
def test_other_sizes_fail_loudly(size: tuple[int, int]) -> None:
    with pytest.raises(RuntimeError):
        CentreNetwork()(torch.zeros(1, 3, *size))
