"""Face tracking in videos: detection, interpolation, prediction, fits with one identity, smoothing."""

from typing import Literal

Smoothing = Literal["none", "mean3", "one-euro", "spline"]
TrackFormat = Literal["csv", "npz", "pts", "video", "glb", "usdc", "arkit"]

# More frames hardly improve the identity: docs/explanation/fitting.md shows its error for numbers of pictures.
IDENTITY_FRAMES = 100
