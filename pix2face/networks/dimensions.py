"""Sizes of the layers of each architecture, from which networks in torch and their graphs in ONNX are made."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import final

from pix2face.networks import MAP_PLANES, MOST_PLANES

PLANES_IN = 3
# Sides of inputs and filters of levels, as far as a network could be run on.
LARGEST_SIDE_PX = MOST_FILTERS = 1024

# The paper's network.
WIDEST = 8  # the deepest levels have eight times the first level's filters
LEAK = 0.2
VARIANCE_FLOOR = 1e-5

# The residual network. Filters of each level, as multiples of the first level's: 32-64-128-192-256-256 for 32.
WIDTH_MULTIPLES = (1, 2, 4, 6, 8, 8)
# Every level halves the picture.
SIZE_DIVISOR = 2 ** len(WIDTH_MULTIPLES)
# Convolutions of a block, from the second level inwards, and from the last but one outwards. One pixel in four of a
# level is left in the next: a convolution more at half resolution costs as much as four a level farther in.
ENCODER_CONVOLUTIONS = (1, 1, 2, 2, 2)
DECODER_CONVOLUTIONS = (2, 2, 1, 1, 0)
# Blocks more at the innermost level, which is so small that they cost next to nothing.
INNER_BLOCKS = 3
# Standard deviations: at 128 px a batch of 24 pictures has 96 values of a channel at the innermost level, of which none
# can be farther than sqrt(95) = 9.7 from their mean, since it counts in their deviation. On the 600 renders that showed
# what it is for, 4 and 8 did the same.
FARTHEST = 8.0
# Landmarks are read from the features of the innermost level but one, averaged to so many places along each side.
LANDMARK_PLACES = 4
LANDMARK_FEATURES = 192

# The correction of fits. Filters at an eighth, a sixteenth and a thirty-second of the side, and features of the whole
# picture.
CORRECTION_WIDTHS = (32, 48, 64)
PICTURE_FEATURES = 128
# The innermost features are averaged to so many places along each side.
CORRECTION_PLACES = 4
# Rotation (three rows), logarithm of the scale, and the image of the model's origin.
CAMERA_FACTS = 12
CAMERA_CHANGES = 6
# A fact farther from its mean counts as so many standard deviations: the fit failed.
FARTHEST_FACT = 5.0
# Units of the answers, about the size of the errors: radians, the logarithm of the scale, the side of the picture, and
# standard deviations of the coefficients.
TURN, GROWTH, SHIFT, CHANGE = 0.1, 0.05, 0.05, 0.3

# The network that finds faces.
CENTRE_STRIDE = 8  # pixels of a cell
CENTRE_MULTIPLE = 32  # of which height and width of a picture must be multiples
CENTRE_PLANES = 5  # logit of the centre; shift right and down in cells; logarithms of width and height in cells
CENTRE_WIDTHS = (16, 24, 40, 80, 128)  # filters at strides 2, 4, 8, 16 and 32
CENTRE_NECK = 32  # filters of the pyramid


@final
@dataclass(frozen=True)
class Architecture:
    """What holds for all networks of one kind."""

    # Filters of each level, from the side (px) and those of the first. It raises ValueError where the network cannot
    # take a picture of this side.
    widths: Callable[[int, int], tuple[int, ...]]
    is_any_size: bool  # whether the same weights take pictures of other sizes


def check_network(
    architecture: str, size_px: int, widths: tuple[int, ...], planes: int, landmarks: int, corrected: int
) -> None:
    """Checks that there is such a network; see ``pix2face.networks.architectures.build_network``.

    Raises:
        ValueError: There is no such architecture, or it cannot have these numbers.
    """
    if architecture not in ARCHITECTURES:
        raise ValueError(f"expected an architecture of {', '.join(ARCHITECTURES)}, found {architecture!r}")
    if not MAP_PLANES <= planes <= MOST_PLANES:
        raise ValueError(f"expected {MAP_PLANES} to {MOST_PLANES} planes, found {planes}")
    known = ARCHITECTURES[architecture].widths(size_px, widths[0] if widths else 0)
    if architecture == "residual":
        if len(widths) != len(known):
            raise ValueError(f"expected the filters of {len(known)} levels, found {len(widths)}")
        return
    if landmarks or corrected:
        raise ValueError(
            f"expected neither landmarks nor corrections of the paper's network, found {landmarks, corrected}"
        )
    if widths != known:
        raise ValueError(f"expected the paper's widths for {size_px} px, found {widths}")


def paper_widths(size_px: int, filters: int) -> tuple[int, ...]:
    """Filters of each level: doubled from one to the next until they are eight times the first.

    Raises:
        ValueError: The size is not a power of two, or below 8.
    """
    if size_px < 8 or size_px & (size_px - 1):
        raise ValueError(f"expected a power of two of at least 8 for the side of the network's input, found {size_px}")
    return tuple(filters * min(2**level, WIDEST) for level in range(size_px.bit_length() - 1))


def residual_widths(filters: int) -> tuple[int, ...]:
    """Filters of each level, from those of the first."""
    return tuple(filters * multiple for multiple in WIDTH_MULTIPLES)


def correction_widths(widths: tuple[int, ...]) -> tuple[int, ...]:
    """Filters of the features that the correction of fits goes by, from those of all levels."""
    return widths[-len(CORRECTION_WIDTHS) - 1 : -1]


def _residual_widths_at(size_px: int, filters: int) -> tuple[int, ...]:
    if size_px < SIZE_DIVISOR or size_px % SIZE_DIVISOR:
        raise ValueError(f"expected a multiple of {SIZE_DIVISOR} for the side of the network's input, found {size_px}")
    return residual_widths(filters)


ARCHITECTURES: Mapping[str, Architecture] = MappingProxyType(
    {
        "paper": Architecture(widths=paper_widths, is_any_size=False),
        "residual": Architecture(widths=_residual_widths_at, is_any_size=True),
    }
)
