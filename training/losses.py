"""What the training minimises."""

from dataclasses import dataclass
from typing import final

from jaxtyping import Float
from torch import Tensor
from torch.nn import functional


@final
@dataclass(frozen=True, eq=False)
class MapLoss:
    """Mean absolute errors, in units of the maps' scales.

    Attributes:
        pncc: Of the first three planes.
        offset: Of the other three.
    """

    pncc: Float[Tensor, ""]
    offset: Float[Tensor, ""]

    @property
    def total(self) -> Float[Tensor, ""]:
        """The mean over all six planes: what is minimised."""
        return (self.pncc + self.offset) / 2


def map_loss(planes: Float[Tensor, "b 6 s s"], target: Float[Tensor, "b 6 s s"]) -> MapLoss:
    """L1 over all pixels; the background counts and should be 0.

    Each map is divided by its own scale, so a millimetre of offset weighs more than a millimetre of PNCC, by the ratio
    of the scales (docs/training.md says what that does).

    Source: Crispell and Bazik 2017, Sec. 3.1.
    """
    return MapLoss(functional.l1_loss(planes[:, :3], target[:, :3]), functional.l1_loss(planes[:, 3:], target[:, 3:]))
