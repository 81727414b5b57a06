import pytest
import torch
from torch import nn

from pix2face.networks.blocks import BoundedBatchNorm
from pix2face.networks.dimensions import FARTHEST, residual_widths
from pix2face.networks.residual import ResidualUNet


def test_the_filters_are_those_of_the_trial():
    assert residual_widths(32) == (32, 64, 128, 192, 256, 256)


def test_about_nine_million_parameters_and_at_most_20_megabytes_as_float16():
    with torch.device("meta"):
        network = ResidualUNet(residual_widths(32), 9, 68)
    assert 8e6 < sum(parameter.numel() for parameter in network.parameters()) < 10e6
    assert 2 * sum(tensor.numel() for tensor in network.state_dict().values()) < 20e6


@pytest.mark.parametrize(("height", "width"), [(64, 64), (128, 128), (64, 192)])
@pytest.mark.parametrize("planes", [6, 8])
def test_any_multiple_of_64_will_do(height, width, planes):
    network = ResidualUNet(residual_widths(2), planes).eval()
    maps = network(torch.rand(1, 3, height, width) - 0.5)
    assert maps.shape == (1, planes, height, width)
    assert torch.isfinite(maps).all()


def test_in_use_a_batch_is_the_same_as_its_pictures_one_by_one():
    torch.manual_seed(0)
    network = ResidualUNet(residual_widths(4)).eval()
    pictures = torch.rand(3, 3, 64, 64) - 0.5
    single = torch.cat([network(picture[None]) for picture in pictures])
    torch.testing.assert_close(network(pictures), single, rtol=1e-4, atol=1e-5)


def test_it_is_fully_convolutional():
    # A picture moved by the size of the innermost pixel gives maps moved as much, far from the borders.
    torch.manual_seed(0)
    network = ResidualUNet(residual_widths(2)).eval()
    wide = torch.rand(1, 3, 64, 64 * 40) - 0.5
    maps, moved = network(wide), network(wide[..., 64:])
    middle = slice(64 * 19, 64 * 20)
    expected = maps[..., 64 * 20 : 64 * 21]
    torch.testing.assert_close(moved[..., middle], expected, rtol=1e-4, atol=1e-5)


def test_every_weight_learns():
    torch.manual_seed(0)
    network = ResidualUNet(residual_widths(4), 8)
    network(torch.rand(4, 3, 64, 64) - 0.5).square().mean().backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None
        assert parameter.grad.abs().max() > 0, name


def test_a_bounded_norm_is_batch_norm_as_far_as_training_goes():
    torch.manual_seed(0)
    plain, bounded = nn.BatchNorm2d(5), BoundedBatchNorm(5)
    weight, bias = torch.tensor([1.0, -2.0, 0.0, 0.5, 3.0]), torch.tensor([0.0, 1.0, -4.0, 5.0, -0.3])
    for norm in (plain, bounded):
        norm.weight.data, norm.bias.data = weight.clone(), bias.clone()
    features = 3 + 2 * torch.randn(24, 5, 2, 2)
    for _ in range(100):
        torch.testing.assert_close(bounded(features), plain(features), rtol=0, atol=0)
    bounded.load_state_dict(plain.state_dict())
    plain.eval(), bounded.eval()
    torch.testing.assert_close(bounded(features), plain(features), rtol=0, atol=0)
    # What training would have kept within sqrt(95) deviations lies hundreds of them off in use.
    far = features.clone()
    far[0], far[1] = 1000, -1000
    assert plain(far)[0].abs().max() > 1000
    for sign, row in ((1, 0), (-1, 1)):
        expected = (bias + sign * FARTHEST * weight)[:, None, None].expand(5, 2, 2)
        torch.testing.assert_close(bounded(far)[row], expected, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(bounded(far)[2:], plain(features)[2:], rtol=0, atol=0)
    assert bounded(far.bfloat16()).dtype == plain(far.bfloat16()).dtype


def test_norms_of_the_innermost_blocks_are_bounded_and_no_others():
    network = ResidualUNet(residual_widths(2))
    bounded = {name for name, module in network.named_modules() if isinstance(module, BoundedBatchNorm)}
    assert bounded == {f"inner.{index}.{norm}" for index in range(3) for norm in ("first_norm", "second_norm")}


def test_landmarks_are_answered_beside_the_planes_and_change_none_of_them():
    torch.manual_seed(0)
    plain = ResidualUNet(residual_widths(4), 9).eval()
    network = ResidualUNet(residual_widths(4), 9, 68).eval()
    network.load_state_dict(plain.state_dict(), strict=False)
    for size in (64, 128):
        pictures = torch.rand(2, 3, size, size) - 0.5
        planes, landmarks = network(pictures)
        torch.testing.assert_close(planes, plain(pictures))
        assert landmarks.shape == (2, 68, 3)
    landmarks.sum().backward()
    assert network.landmarks.first.weight.grad.abs().max() > 0
