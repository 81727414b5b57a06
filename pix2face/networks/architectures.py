"""The architectures by name: what a recipe or a checkpoint names becomes a network."""

from torch import nn

from pix2face.networks.dimensions import check_network
from pix2face.networks.paper import UNet
from pix2face.networks.residual import ResidualUNet


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
    check_network(architecture, size_px, widths, planes, landmarks, corrected)
    if architecture == "paper":
        return UNet(size_px, widths[0], planes)
    return ResidualUNet(widths, planes, landmarks, corrected)
