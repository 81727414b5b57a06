"""Files that describe faces: coefficients, annotations, boxes."""
