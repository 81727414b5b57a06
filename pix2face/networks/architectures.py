"""The architectures by name: what a recipe or a checkpoint names becomes a network."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import final

from torch import nn

from pix2face.networks import MAP_PLANES, MOST_PLANES
from pix2face.networks.paper import UNet, level_count, paper_widths
from pix2face.networks.residual import SIZE_DIVISOR, ResidualUNet, residual_widths

# Planes after the six of the maps: logits of the mask, then of the part of it that is seen; the scale of PNCC's errors.
MASK_PLANE, SEEN_PLANE, SCALE_PLANE = MAP_PLANES, MAP_PLANES + 1, MAP_PLANES + 2


@final
@dataclass(frozen=True)
class Architecture:
    """How to make networks of one kind."""

    widths: Callable[[int, int], tuple[int, ...]]  # filters of each level, from the side (px) and those of the first
    # From the side (px), filters of each level, planes, landmarks, and coefficients that are corrected.
    build: Callable[[int, tuple[int, ...], int, int, int], nn.Module]
    check_size: Callable[[int], object]  # raises ValueError where the network cannot take a picture of a side
    is_any_size: bool  # whether the same weights take pictures of other sizes


def build_network(
    architecture: str, size_px: int, widths: tuple[int, ...], planes: int, landmarks: int = 0, corrected: int = 0
) -> nn.Module:
    """Makes a network with new weights, drawn from torch's generator.

    Widths are the filters of each level. The planes of the output are 6 of the maps, up to two of masks, and one of
    scales. Landmarks are those that the network predicts beside the planes, and ``corrected`` is the number of
    coefficients of the fits that it corrects; 0 for none.

    Raises:
        ValueError: There is no such architecture, or it cannot have these numbers.
    """
    if architecture not in ARCHITECTURES:
        raise ValueError(f"expected an architecture of {', '.join(ARCHITECTURES)}, found {architecture!r}")
    if not MAP_PLANES <= planes <= MOST_PLANES:
        raise ValueError(f"expected {MAP_PLANES} to {MOST_PLANES} planes, found {planes}")
    chosen = ARCHITECTURES[architecture]
    chosen.check_size(size_px)
    return chosen.build(size_px, widths, planes, landmarks, corrected)


def _paper(size_px: int, widths: tuple[int, ...], planes: int, landmarks: int, corrected: int) -> nn.Module:
    if landmarks or corrected:
        raise ValueError(
            f"expected neither landmarks nor corrections of the paper's network, found {landmarks, corrected}"
        )
    if not widths or widths != paper_widths(size_px, widths[0]):
        raise ValueError(f"expected the paper's widths for {size_px} px, found {widths}")
    return UNet(size_px, widths[0], planes)


def _check_divisible(size_px: int) -> None:
    if size_px < SIZE_DIVISOR or size_px % SIZE_DIVISOR:
        raise ValueError(f"expected a multiple of {SIZE_DIVISOR} for the side of the network's input, found {size_px}")


ARCHITECTURES: Mapping[str, Architecture] = MappingProxyType(
    {
        "paper": Architecture(widths=paper_widths, build=_paper, check_size=level_count, is_any_size=False),
        "residual": Architecture(
            widths=lambda size_px, filters: residual_widths(filters),
            build=lambda size_px, widths, planes, landmarks, corrected: ResidualUNet(
                widths, planes, landmarks, corrected
            ),
            check_size=_check_divisible,
            is_any_size=True,
        ),
    }
)
