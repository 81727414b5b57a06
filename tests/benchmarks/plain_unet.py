"""The paper's network as a textbook would write it: torch's own layers, float32, planes first in memory."""

import torch
from torch import Tensor, nn

from pix2face.networks import MAP_PLANES
from pix2face.networks.dimensions import LEAK, PLANES_IN, paper_widths
from pix2face.networks.paper import UNet


class PlainUNet(nn.Module):
    """Computes what ``UNet`` computes, and takes its weights."""

    def __init__(self, size_px: int, filters: int) -> None:
        super().__init__()
        widths = paper_widths(size_px, filters)
        self.encoder = nn.ModuleList(
            nn.Conv2d(before, after, 4, 2, 1) for before, after in zip((PLANES_IN, *widths), widths, strict=False)
        )
        inputs = [widths[-1], *(2 * width for width in widths[-2::-1])]
        outputs = [*widths[-2::-1], MAP_PLANES]
        self.decoder = nn.ModuleList(
            nn.Conv2d(before, after, 3, padding=1) for before, after in zip(inputs, outputs, strict=True)
        )
        self.encoder_norms = nn.ModuleList(nn.InstanceNorm2d(width) for width in widths)
        self.decoder_norms = nn.ModuleList(nn.InstanceNorm2d(width) for width in outputs)
        self.leaky, self.relu = nn.LeakyReLU(LEAK), nn.ReLU()
        self.enlarge = nn.Upsample(scale_factor=2, mode="bilinear")

    def forward(self, image: Tensor) -> Tensor:
        features, skips = image, []
        for level, (convolution, norm) in enumerate(zip(self.encoder, self.encoder_norms, strict=True)):
            features = convolution(self.leaky(features) if level else features)
            if 0 < level < len(self.encoder) - 1:
                features = norm(features)
            skips.append(features)
        skips.pop()
        for convolution, norm in zip(self.decoder, self.decoder_norms, strict=True):
            features = convolution(self.enlarge(self.relu(features)))
            if skips:
                features = torch.cat([norm(features), skips.pop()], dim=1)
        return features

    def take_weights(self, network: UNet) -> None:
        """Starts from the same weights, planes first in memory."""
        self.load_state_dict({name: tensor.contiguous() for name, tensor in network.state_dict().items()})
