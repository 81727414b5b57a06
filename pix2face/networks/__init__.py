"""Networks from a picture of a face to its maps, one architecture a file; ``architectures`` knows them by name."""

from typing import Literal

ArchitectureName = Literal["paper", "residual"]

MAP_PLANES = 6  # PNCC x, y, z, then offset x, y, z; planes after these are masks
MOST_PLANES = MAP_PLANES + 2  # logits of the mask, then of the part of it that is seen
