"""The U-Net of the paper: a picture of a face in, PNCC and offset out."""

from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from pix2face.networks import MAP_PLANES
from pix2face.networks.dimensions import LEAK, PLANES_IN, VARIANCE_FLOOR, paper_widths


@final
class UNet(nn.Module):
    """Strided convolutions down to one pixel and back up, with a skip connection at each size.

    Encoder: 4x4 convolutions of stride 2, LeakyReLU, instance norm (none after the first, which would take out the
    picture's colour, and none after the last, whose single pixel it would set to 0). Decoder: ReLU, bilinear x2, 3x3
    convolution, instance norm (none at the output), then the encoder's features of that size.

    The output is linear. Deviation from the authors' code, which ends in tanh: the scales here reach exactly to the
    largest target (±1), which tanh would only reach at infinity; the paper itself names no such layer.

    Weights and features are kept channels last, the layout in which these operations are fastest.

    Args:
        size_px: Side of the picture, a power of two; 256 in the paper. There are log2(size_px) levels: 8 there.
        filters: Filters of the first level; 64 in the paper.
        planes: Planes of the output; 6 in the paper.

    Source: Crispell and Bazik 2017, Sec. 3.1; Ronneberger et al. 2015.
    """

    def __init__(self, size_px: int, filters: int, planes: int = MAP_PLANES) -> None:
        super().__init__()
        widths = paper_widths(size_px, filters)
        self.encoder = nn.ModuleList(
            nn.Conv2d(before, after, kernel_size=4, stride=2, padding=1)
            for before, after in zip([PLANES_IN, *widths], widths, strict=False)
        )
        # From the inside out: the innermost convolution has no skip beside its input, all others have.
        inputs = [widths[-1], *(2 * width for width in widths[-2::-1])]
        outputs = [*widths[-2::-1], planes]
        self.decoder = nn.ModuleList(
            nn.Conv2d(before, after, kernel_size=3, padding=1) for before, after in zip(inputs, outputs, strict=True)
        )
        self.apply(_initialise)

    def forward(self, image: Float[Tensor, "b 3 s s"]) -> Float[Tensor, "b planes s s"]:
        """Maps pictures (pixels in [-0.5, 0.5]) to PNCC and offset, and to logits of masks where there are any.

        PNCC and offset are in units of their scales (about ±1), and about 0 in the background.
        """
        features, skips = image.contiguous(memory_format=torch.channels_last), []
        for level, convolution in enumerate(self.encoder):
            features = convolution(functional.leaky_relu(features, LEAK) if level else features)
            if 0 < level < len(self.encoder) - 1:
                features = _instance_norm(features)
            skips.append(features)
        skips.pop()
        for convolution in self.decoder:
            enlarged = functional.interpolate(functional.relu(features), scale_factor=2.0, mode="bilinear")
            features = convolution(enlarged)
            if skips:
                features = torch.cat([_instance_norm(features), skips.pop()], dim=1)
        return features


def _instance_norm(features: Tensor) -> Tensor:
    """Mean 0 and variance 1 for each plane of each picture, without learned scale and shift.

    Written out because torch's own copies channels-last tensors back and forth: whole training steps are 1.6 times
    faster like this on a CPU.
    """
    variance, mean = torch.var_mean(features, dim=(2, 3), keepdim=True, correction=0)
    return (features - mean) * torch.rsqrt(variance + VARIANCE_FLOOR)


def _initialise(module: nn.Module) -> None:
    """Normal weights of standard deviation 0.02, as image-to-image networks of this kind are started."""
    if isinstance(module, nn.Conv2d):
        module.weight.data = module.weight.data.contiguous(memory_format=torch.channels_last)
        if module.weight.is_meta:  # shapes alone; torch would load its compiler to draw numbers for them: seconds
            return
        nn.init.normal_(module.weight, std=0.02)
        assert module.bias is not None
        nn.init.zeros_(module.bias)
