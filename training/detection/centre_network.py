"""A network that finds faces: for each cell of a picture, how surely a face has its centre there, and the face's box.

Sources: Zhou et al. 2019, Objects as Points (heatmap of centres); Lin et al. 2017, Feature Pyramid Networks.
"""

from collections.abc import Sequence
from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from pix2face.networks.dimensions import CENTRE_NECK, CENTRE_PLANES, CENTRE_WIDTHS

# At the start a centre is as rare as it is in pictures, so that the first steps need not learn that.
RARE_LOGIT = -4.6


@final
class CentreNetwork(nn.Module):
    """A small residual network whose levels are added up at stride 8.

    Args:
        widths: Filters at strides 2, 4, 8, 16 and 32.
        neck: Filters of the pyramid.
    """

    def __init__(self, widths: Sequence[int] = CENTRE_WIDTHS, neck: int = CENTRE_NECK) -> None:
        super().__init__()
        at2, at4, at8, at16, at32 = widths
        self.to4 = nn.Sequential(_layer(3, at2, stride=2), _layer(at2, at4, stride=2))
        self.to8 = nn.Sequential(_layer(at4, at8, stride=2), _Residual(at8))
        self.to16 = nn.Sequential(_layer(at8, at16, stride=2), _Residual(at16), _Residual(at16))
        self.to32 = nn.Sequential(_layer(at16, at32, stride=2), _Residual(at32))
        self.side8, self.side16, self.side32 = (_linear(width, neck, 1) for width in (at8, at16, at32))
        self.mixed16, self.mixed8 = _layer(neck, neck), _layer(neck, neck)
        self.answer = nn.Conv2d(neck, CENTRE_PLANES, 1)
        nn.init.normal_(self.answer.weight, std=0.01)
        nn.init.zeros_(self.answer.bias)  # type: ignore[arg-type]
        with torch.no_grad():
            self.answer.bias[0] = RARE_LOGIT  # type: ignore[index]

    def forward(self, pictures: Float[Tensor, "b 3 h w"]) -> Float[Tensor, "b 5 h/8 w/8"]:
        """Answers for pictures in [-0.5, 0.5] whose height and width are multiples of 32."""
        at8 = self.to8(self.to4(pictures))
        at16 = self.to16(at8)
        coarse = self.side32(self.to32(at16))
        coarse = self.mixed16(functional.relu(self.side16(at16) + _enlarged(coarse)))
        return self.answer(self.mixed8(functional.relu(self.side8(at8) + _enlarged(coarse))))


@final
class _Residual(nn.Module):
    def __init__(self, width: int) -> None:
        super().__init__()
        self.inner = nn.Sequential(*_layer(width, width), *_linear(width, width, 3))

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(x + self.inner(x))


def _linear(n_in: int, n_out: int, kernel: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(n_in, n_out, kernel, stride, padding=kernel // 2, bias=False), nn.BatchNorm2d(n_out))


def _layer(n_in: int, n_out: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(*_linear(n_in, n_out, 3, stride), nn.ReLU(inplace=True))


def _enlarged(x: Tensor) -> Tensor:
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")
