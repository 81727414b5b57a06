"""Files that describe faces: coefficients, annotations, boxes."""

# Farther from the corner of a picture there is no box.
LARGEST_BOX_PX = 1e6
