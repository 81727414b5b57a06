"""From maps or landmarks to a camera and the coefficients of a morphable model."""
