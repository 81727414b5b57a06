"""Corrects fits: from what the network saw and the fit to its maps, to the camera and coefficients of the true face.

The maps are answered pixel by pixel. What their errors have in common turns, moves and scales the fitted camera, and
the features of the network know more of it than the maps say.
"""

import math
from collections import OrderedDict
from collections.abc import Sequence
from itertools import pairwise
from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.nn import functional

from pix2face.networks.blocks import ResidualBlock
from pix2face.networks.dimensions import (
    CAMERA_CHANGES,
    CAMERA_FACTS,
    CHANGE,
    CORRECTION_PLACES,
    CORRECTION_WIDTHS,
    FARTHEST_FACT,
    GROWTH,
    PICTURE_FEATURES,
    SHIFT,
    TURN,
)

DROPPED_SHARE = 0.2


@final
class FitCorrection(nn.Module):
    """Changes a weak-perspective camera and coefficients. At the start it changes nothing.

    Args:
        level_widths: Filters of the three levels of features that it sees, from the outermost inwards; each is half as
            large as the one before.
        coefficients: Number of coefficients of the morphable model, identity and expression.
    """

    def __init__(self, level_widths: Sequence[int], coefficients: int) -> None:
        super().__init__()
        self.narrow = nn.ModuleList(
            narrowing(before, after) for before, after in zip(level_widths, CORRECTION_WIDTHS, strict=True)
        )
        self.blocks = nn.ModuleList(
            ResidualBlock(before, after, 2, halves=True) for before, after in pairwise(CORRECTION_WIDTHS)
        )
        self.last = ResidualBlock(CORRECTION_WIDTHS[-1], CORRECTION_WIDTHS[-1], 2)
        self.pool = nn.AdaptiveAvgPool2d(CORRECTION_PLACES)
        facts = CAMERA_FACTS + coefficients
        self.fact_norm = nn.BatchNorm1d(facts, affine=False)
        self.facts = nn.Linear(facts, PICTURE_FEATURES)
        self.first = nn.Linear(
            CORRECTION_WIDTHS[-1] * CORRECTION_PLACES**2 + PICTURE_FEATURES, PICTURE_FEATURES, bias=False
        )
        self.first_norm = nn.BatchNorm1d(PICTURE_FEATURES)
        self.second = nn.Linear(PICTURE_FEATURES, CAMERA_CHANGES + coefficients)
        for module in self.modules():
            if isinstance(module, nn.Conv2d) and not module.weight.is_meta:
                nn.init.kaiming_normal_(module.weight, nonlinearity="relu")
        for weights in self.second.parameters():
            nn.init.zeros_(weights)

    def forward(
        self,
        levels: Sequence[Float[Tensor, "b _ _ _"]],
        cameras: Float[Tensor, "b 2 4"],
        coefficients: Float[Tensor, "b c"],
    ) -> tuple[Float[Tensor, "b 2 4"], Float[Tensor, "b c"]]:
        """Returns cameras and coefficients that are nearer to the true ones: ``corrected`` by what is ``seen``."""
        return self.corrected(self.seen(levels), cameras, coefficients)

    def seen(self, levels: Sequence[Float[Tensor, "b _ _ _"]]) -> Float[Tensor, "b n"]:
        """What the correction goes by of each picture, whatever its fit.

        Args:
            levels: Features of the network, from the outermost of the three levels inwards.
        """
        first, *others = (narrow(level) for narrow, level in zip(self.narrow, levels, strict=True))
        features = functional.relu(first)
        for block, level in zip(self.blocks, others, strict=True):
            features = functional.relu(block(features) + level)
        seen: Tensor = self.pool(self.last(features).float()).flatten(1)
        return seen

    def corrected(
        self, seen: Float[Tensor, "b n"], cameras: Float[Tensor, "b 2 4"], coefficients: Float[Tensor, "b c"]
    ) -> tuple[Float[Tensor, "b 2 4"], Float[Tensor, "b c"]]:
        """Returns cameras and coefficients that are nearer to the true ones.

        Args:
            seen: Of each picture.
            cameras: Rows of the fitted weak-perspective cameras, from mm to the picture's side (its middle is 0).
            coefficients: Fitted, standard deviations, identity before expression.
        """
        with torch.autocast(seen.device.type, enabled=False):
            return self._corrected(seen, cameras, coefficients)

    def _corrected(
        self, seen: Float[Tensor, "b n"], cameras: Float[Tensor, "b 2 4"], coefficients: Float[Tensor, "b c"]
    ) -> tuple[Float[Tensor, "b 2 4"], Float[Tensor, "b c"]]:
        rotation, scale = rotation_and_scale(cameras)
        middle = cameras[:, :, 3]
        facts = torch.cat((rotation.flatten(1), scale.log()[:, None], middle, coefficients), dim=1)
        facts = self.fact_norm(facts).clamp(-FARTHEST_FACT, FARTHEST_FACT)
        facts = functional.relu(self.facts(functional.dropout(facts, DROPPED_SHARE, self.training)))
        seen = functional.dropout(seen, DROPPED_SHARE, self.training)
        features = functional.relu(self.first_norm(self.first(torch.cat((seen, facts), dim=1))))
        changes = self.second(features)
        turned = rotation_of(TURN * changes[:, :3]) @ rotation
        scale = scale * (GROWTH * changes[:, 3]).exp()
        middle = middle + SHIFT * changes[:, 4:CAMERA_CHANGES]
        corrected = torch.cat((scale[:, None, None] * turned[:, :2], middle[:, :, None]), dim=2)
        return corrected, coefficients + CHANGE * changes[:, CAMERA_CHANGES:]


def narrowing(before: int, after: int) -> nn.Sequential:
    """Makes features of fewer filters, normalised."""
    change = nn.Conv2d(before, after, kernel_size=1, bias=False)
    return nn.Sequential(OrderedDict(change=change, change_norm=nn.BatchNorm2d(after)))


def rotation_and_scale(cameras: Float[Tensor, "b 2 4"]) -> tuple[Float[Tensor, "b 3 3"], Float[Tensor, " b"]]:
    """Rotation (camera_from_model) and scale of the rows of weak-perspective cameras; nearly so of affine ones."""
    lengths = cameras[:, :, :3].norm(dim=2, keepdim=True)
    rows = cameras[:, :, :3] / lengths
    return torch.cat((rows, torch.linalg.cross(rows[:, :1], rows[:, 1:])), dim=1), lengths.mean(dim=(1, 2))


def rotation_of(vectors: Float[Tensor, "b 3"]) -> Float[Tensor, "b 3 3"]:
    """Rotations by the length of each vector (radians) about its direction (Rodrigues' formula)."""
    squared = vectors.square().sum(dim=1)[:, None, None]
    angle = (squared + torch.finfo(vectors.dtype).tiny).sqrt()
    x, y, z = vectors.unbind(dim=1)
    zero = torch.zeros_like(x)
    cross = torch.stack((zero, -z, y, z, zero, -x, -y, x, zero), dim=1).reshape(-1, 3, 3)
    identity = torch.eye(3, dtype=vectors.dtype, device=vectors.device)
    # sin(a) / a and (1 - cos(a)) / a^2, which are finite and smooth at 0.
    return (
        identity + torch.sinc(angle / math.pi) * cross + torch.sinc(angle / (2 * math.pi)).square() / 2 * cross @ cross
    )
