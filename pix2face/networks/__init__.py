"""Networks from a picture of a face to its maps, one architecture a file; ``architectures`` knows them by name."""

from typing import Literal

ArchitectureName = Literal["paper", "residual"]

MAP_PLANES = 6  # PNCC x, y, z, then offset x, y, z; planes after these are masks
# Logits of the mask and of the part of it that is seen, then the logarithm of the scale of the errors of PNCC.
MOST_PLANES = MAP_PLANES + 3
# For each landmark its place right and down from the middle, and the logarithm of the scale of its error, all in units
# of the picture's side.
LANDMARK_NUMBERS = 3
