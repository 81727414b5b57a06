import pytest
import torch
from torch import nn

from pix2face.networks.dimensions import paper_widths
from pix2face.networks.paper import UNet


def test_the_papers_network_has_the_papers_layers():
    with torch.device("meta"):
        network = UNet(256, 64)
    assert [layer.out_channels for layer in network.encoder] == [64, 128, 256, 512, 512, 512, 512, 512]
    assert all(layer.kernel_size == (4, 4) and layer.stride == (2, 2) for layer in network.encoder)
    assert [layer.in_channels for layer in network.decoder] == [512, 1024, 1024, 1024, 1024, 512, 256, 128]
    assert [layer.out_channels for layer in network.decoder] == [512, 512, 512, 512, 256, 128, 64, 6]
    assert all(layer.kernel_size == (3, 3) for layer in network.decoder)


@pytest.mark.parametrize("size_px", [8, 32, 64])
def test_six_planes_of_the_same_size(size_px):
    planes = UNet(size_px, 4)(torch.rand(2, 3, size_px, size_px) - 0.5)
    assert planes.shape == (2, 6, size_px, size_px)
    assert torch.isfinite(planes).all()


def test_a_batch_is_the_same_as_its_pictures_one_by_one():
    torch.manual_seed(0)
    network = UNet(32, 8)
    pictures = torch.rand(3, 3, 32, 32) - 0.5
    single = torch.cat([network(picture[None]) for picture in pictures])
    torch.testing.assert_close(network(pictures), single, rtol=1e-4, atol=1e-6)


def test_every_weight_learns_and_the_middle_level_is_not_normalised_away():
    torch.manual_seed(0)
    network = UNet(32, 4)
    network(torch.rand(2, 3, 32, 32) - 0.5).square().mean().backward()
    for name, parameter in network.named_parameters():
        if name.endswith("weight"):
            assert parameter.grad is not None
            assert parameter.grad.abs().max() > 0, name


def test_the_norm_is_torchs_instance_norm():
    # The oracle: the same forward pass, written with torch's own layers.
    torch.manual_seed(0)
    network = UNet(32, 8)
    picture = torch.rand(2, 3, 32, 32) - 0.5
    features, skips = picture, []
    for level, convolution in enumerate(network.encoder):
        features = convolution(nn.LeakyReLU(0.2)(features) if level > 0 else features)
        if level in (1, 2, 3):
            features = nn.InstanceNorm2d(features.shape[1])(features)
        skips.append(features)
    for level, convolution in enumerate(network.decoder):
        upsampled = nn.Upsample(scale_factor=2, mode="bilinear")(nn.ReLU()(features))
        features = convolution(upsampled)
        if level < 4:
            features = torch.cat([nn.InstanceNorm2d(features.shape[1])(features), skips[3 - level]], dim=1)
    torch.testing.assert_close(network(picture), features, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("size_px", [0, -8, 4, 100, 255])
def test_sizes_that_cannot_be_halved_to_one_pixel_are_refused(size_px):
    with pytest.raises(ValueError, match=f"power of two.*found {size_px}"):
        paper_widths(size_px, 4)
