import pytest
import torch

from pix2face.networks.architectures import build_network
from pix2face.networks.dimensions import ARCHITECTURES


@pytest.mark.parametrize("name", list(ARCHITECTURES))
@pytest.mark.parametrize("planes", [6, 7, 8])
def test_a_name_becomes_a_network(name, planes):
    widths = ARCHITECTURES[name].widths(64, 2)
    network = build_network(name, 64, widths, planes)
    assert network(torch.zeros(2, 3, 64, 64)).shape == (2, planes, 64, 64)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("transformer", 64, (4,), 6), "an architecture of paper, residual, found 'transformer'"),
        (("paper", 64, (4, 8), 6), r"the paper's widths for 64 px, found \(4, 8\)"),
        (("paper", 100, (4, 8), 6), "a power of two"),
        (("residual", 96, (2, 4, 8, 12, 16, 16), 6), "a multiple of 64 .* found 96"),
        (("residual", 64, (2, 4, 8, 12, 16, 16), 5), "6 to 9 planes, found 5"),
        (("residual", 64, (2, 4, 8), 6), "filters of 6 levels, found 3"),
    ],
)
def test_what_no_network_has_is_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        build_network(*arguments)
