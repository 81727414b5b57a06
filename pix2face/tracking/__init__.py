"""Faces through videos: detect, fill gaps, predict, fit with one identity, smooth."""

from typing import Literal

Smoothing = Literal["none", "mean3", "one-euro", "spline"]
TrackFormat = Literal["csv", "npz", "pts", "video", "glb", "usdc", "arkit"]

# The identity is settled long before: docs/explanation/fitting.md shows how its error falls with the number
# of pictures.
IDENTITY_FRAMES = 100
