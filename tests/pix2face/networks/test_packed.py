import pytest
import torch

from pix2face.networks import packed as module
from pix2face.networks.blocks import BoundedBatchNorm
from pix2face.networks.packed import packed
from pix2face.networks.paper import UNet
from pix2face.networks.residual import ResidualUNet, residual_widths

needs_bfloat16 = pytest.mark.skipif(not module.has_bfloat16(), reason="this processor does not compute in bfloat16")
PICTURES = torch.rand(3, 3, 64, 128, generator=torch.Generator().manual_seed(0)) - 0.5


def network(planes=9, inner_variance=1e-3):
    """A network whose norms have something to fold; those of the innermost blocks reach their bounds."""
    torch.manual_seed(1)
    made = ResidualUNet(residual_widths(4), planes, 68)
    with torch.no_grad():
        for _ in range(3):
            made(torch.rand(4, 3, 64, 64) - 0.5)
    for part in made.modules():
        if isinstance(part, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(part.weight, 0.5, 1.5)
            torch.nn.init.normal_(part.bias)
        if isinstance(part, BoundedBatchNorm):
            part.running_var.mul_(inner_variance)
    return made.eval()


def difference(found, expected):
    """The largest, as a share of the largest value."""
    return (found - expected).abs().max() / expected.abs().max()


def answers(of, pictures=PICTURES):
    with torch.inference_mode():
        return of(pictures)


@pytest.mark.parametrize("planes", [6, 9])
def test_a_packed_network_answers_the_same_without_the_plane_of_scales(planes):
    expected, expected_landmarks = answers(network(planes))
    ready = packed(network(planes), torch.float32)
    for pictures in (PICTURES, PICTURES[:1, :, :, :64]):  # made for the first size, it takes others
        found, landmarks = answers(ready, pictures)
        assert found.shape == (len(pictures), min(planes, 8), *pictures.shape[2:])
    found, landmarks = answers(ready)
    assert difference(found, expected[:, :8]) < 1e-3
    assert difference(landmarks, expected_landmarks) < 1e-3


def test_the_test_above_reaches_the_bounds(monkeypatch):
    within = answers(network())[0]
    monkeypatch.setattr("pix2face.networks.blocks.FARTHEST", 1e6)
    assert difference(answers(network())[0], within) > 0.1


@needs_bfloat16
def test_in_bfloat16_it_is_nearly_the_same_and_exactly_so_for_each_picture_of_a_batch():
    expected, expected_landmarks = answers(network(inner_variance=1))  # small ones would make the rounding large
    ready = packed(network(inner_variance=1))
    found, landmarks = answers(ready)
    assert found.dtype == landmarks.dtype == torch.float32
    assert 1e-3 < difference(found, expected[:, :8]) < 0.05
    assert difference(landmarks, expected_landmarks) < 0.05
    assert torch.equal(answers(ready, PICTURES[:1])[0], found[:1])


def test_without_bfloat16_it_computes_in_float32(monkeypatch):
    monkeypatch.setattr(torch.cpu, "get_capabilities", dict, raising=False)
    expected = answers(network())[0][:, :8]
    assert difference(answers(packed(network()))[0], expected) < 1e-3


def test_what_it_does_not_know_comes_back_as_it_is(monkeypatch):
    paper, residual = UNet(32, 4), network()
    assert packed(paper) is paper
    monkeypatch.setattr(torch.backends.mkldnn, "is_available", lambda: False)
    state = residual.state_dict()
    assert packed(residual) is residual
    assert residual.state_dict().keys() == state.keys()
