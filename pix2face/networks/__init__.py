"""Networks from a picture of a face to its maps, one architecture a file; ``architectures`` knows them by name."""

from typing import Literal

ArchitectureName = Literal["paper", "residual"]

MAP_PLANES = 6  # PNCC x, y, z, then offset x, y, z
# Planes after those of the maps: logits of the mask, then of the part of it that is seen; the logarithm of the scale of
# the errors of PNCC.
MASK_PLANE, SEEN_PLANE, SCALE_PLANE = MAP_PLANES, MAP_PLANES + 1, MAP_PLANES + 2
MOST_PLANES = MAP_PLANES + 3
# For each landmark its place right and down from the middle, and the logarithm of the scale of its error, all in units
# of the picture's side.
LANDMARK_NUMBERS = 3
