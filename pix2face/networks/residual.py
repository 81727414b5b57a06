"""A U-Net of residual blocks with batch norm: most of its weights where there are few pixels, so fast without a GPU."""

from itertools import pairwise
from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from pix2face.networks import LANDMARK_NUMBERS, MAP_PLANES
from pix2face.networks.blocks import ResidualBlock
from pix2face.networks.correction import FitCorrection
from pix2face.networks.dimensions import (
    CORRECTION_WIDTHS,
    DECODER_CONVOLUTIONS,
    ENCODER_CONVOLUTIONS,
    INNER_BLOCKS,
    LANDMARK_FEATURES,
    LANDMARK_PLACES,
    PLANES_IN,
    correction_widths,
)

# Planes start near 0, where the background stays.
OUTPUT_GAIN = 0.1
# At the start a landmark is known to a tenth of the side.
FIRST_LOG_SCALE = -2.3


@final
class ResidualUNet(nn.Module):
    """Residual blocks down to 1/64 of the side and back up; what skips across is added, not concatenated.

    It is fully convolutional: any picture whose sides are multiples of 64 will do, whatever the network was trained on.
    The planes are a sum of what all levels of the decoder answer. The finest answers four pixels at a time (pixel
    shuffle); the answers of the others, which are smooth, are enlarged linearly.

    Deviation from the paper: residual blocks, batch norm (bounded in the innermost blocks), six levels instead of eight
    at 256 px, and a first level of half as many filters; docs/explanation/training.md gives the measurements.

    Args:
        widths: Filters of each level.
        planes: Planes of the output: PNCC, offset, logits of masks, and the logarithm of the scale of PNCC's errors.
        landmarks: Number of landmarks that are predicted beside the planes, each with the scale of its error.
        corrected: Number of coefficients of the fits that the network can correct (``correction``); 0 for none.

    Source: He et al. 2016 (blocks); Shi et al. 2016 (pixel shuffle); Lin et al. 2017 (answers of all levels); Wood et
    al. 2022 (landmarks with scales).
    """

    def __init__(
        self, widths: tuple[int, ...], planes: int = MAP_PLANES, landmarks: int = 0, corrected: int = 0
    ) -> None:
        super().__init__()
        self.stem = nn.Conv2d(PLANES_IN, widths[0], kernel_size=3, stride=2, padding=1, bias=False)
        self.stem_norm = nn.BatchNorm2d(widths[0])
        self.encoder = nn.ModuleList(
            ResidualBlock(before, after, convolutions, halves=True)
            for before, after, convolutions in zip(widths, widths[1:], ENCODER_CONVOLUTIONS, strict=False)
        )
        self.inner = nn.ModuleList(
            ResidualBlock(widths[-1], widths[-1], 2, has_bounded_norms=True) for _ in range(INNER_BLOCKS)
        )
        outwards = widths[::-1]
        self.narrow = nn.ModuleList(
            nn.Conv2d(before, after, kernel_size=1, bias=False) for before, after in pairwise(outwards)
        )
        self.decoder = nn.ModuleList(
            ResidualBlock(width, width, convolutions) if convolutions else nn.Identity()
            for width, convolutions in zip(outwards[1:], DECODER_CONVOLUTIONS, strict=True)
        )
        self.coarse_planes = nn.ModuleList(nn.Conv2d(width, planes, kernel_size=1) for width in outwards[1:-1])
        self.planes = nn.Conv2d(widths[0], 4 * planes, kernel_size=3, padding=1)
        self.landmarks = LandmarkHead(outwards[1], landmarks) if landmarks else None
        self.correction = FitCorrection(correction_widths(widths), corrected) if corrected else None
        self.apply(_initialise)
        for weights in self.coarse_planes.parameters():
            nn.init.zeros_(weights)

    def forward(
        self, image: Float[Tensor, "b 3 h w"]
    ) -> Float[Tensor, "b planes h w"] | tuple[Float[Tensor, "b planes h w"], Float[Tensor, "b n 3"]]:
        """Maps pictures as the paper's network does; their sides are multiples of 64.

        With landmarks, it returns the planes and, for each landmark, its place and the logarithm of its scale (see
        ``LANDMARK_NUMBERS``).
        """
        planes, landmarks, _ = self.read(image)
        return planes if landmarks is None else (planes, landmarks)

    def read(
        self, image: Float[Tensor, "b 3 h w"]
    ) -> tuple[Float[Tensor, "b planes h w"], Float[Tensor, "b n 3"] | None, list[Float[Tensor, "b _ _ _"]]]:
        """Returns planes, landmarks, and the features that ``correction`` goes by."""
        picture = image.contiguous(memory_format=torch.channels_last)
        features, skips = functional.relu(self.stem_norm(self.stem(picture)), inplace=True), []
        for block in self.encoder:
            skips.append(features)
            features = block(features)
        for block in self.inner:
            features = block(features)
        landmarks, coarse = None, None
        levels: list[Tensor] = []
        for narrow, block, answer in zip(self.narrow, self.decoder, (*self.coarse_planes, None), strict=True):
            # Narrowed before it is enlarged: a quarter of the work, and the same result.
            enlarged = functional.interpolate(narrow(features), scale_factor=2.0, mode="nearest")
            features = block(enlarged + skips.pop())
            levels.insert(0, features)
            if landmarks is None and self.landmarks is not None:
                landmarks = self.landmarks(features)
            if answer is not None:
                coarse = answer(features) if coarse is None else answer(features) + _enlarged(coarse, 2)
        assert coarse is not None
        planes = functional.pixel_shuffle(self.planes(features), 2) + _enlarged(coarse, 4)
        return planes, landmarks, levels[-len(CORRECTION_WIDTHS) :]


@final
class LandmarkHead(nn.Module):
    """Landmarks from the features of the whole picture.

    Args:
        width: Filters of the features.
        landmarks: Number of landmarks.
    """

    def __init__(self, width: int, landmarks: int) -> None:
        super().__init__()
        self.pool = nn.AdaptiveAvgPool2d(LANDMARK_PLACES)
        self.first = nn.Linear(width * LANDMARK_PLACES**2, LANDMARK_FEATURES)
        self.second = nn.Linear(LANDMARK_FEATURES, landmarks * LANDMARK_NUMBERS)
        with torch.no_grad():
            self.second.weight.mul_(OUTPUT_GAIN)
            self.second.bias.view(-1, LANDMARK_NUMBERS)[:, 2] = FIRST_LOG_SCALE

    def forward(self, features: Float[Tensor, "b c y x"]) -> Float[Tensor, "b n 3"]:
        """Places and scales."""
        # Places need more digits than bfloat16 has.
        with torch.autocast(features.device.type, enabled=False):
            flat = self.pool(features.float()).flatten(1)
            return self.second(functional.relu(self.first(flat))).unflatten(1, (-1, LANDMARK_NUMBERS))


def _enlarged(planes: Tensor, factor: int) -> Tensor:
    return functional.interpolate(planes, scale_factor=factor, mode="bilinear")


def _initialise(module: nn.Module) -> None:
    """Normal weights that keep the variance through ReLU, channels last; planes start near 0."""
    if isinstance(module, nn.Conv2d):
        module.weight.data = module.weight.data.contiguous(memory_format=torch.channels_last)
        if module.weight.is_meta:  # shapes alone; torch would load its compiler to draw numbers for them: seconds
            return
        nn.init.kaiming_normal_(module.weight, mode="fan_in", nonlinearity="relu")
        if module.bias is not None:
            module.weight.data.mul_(OUTPUT_GAIN)
            nn.init.zeros_(module.bias)
