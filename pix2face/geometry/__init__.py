"""Cameras, crops, maps and landmarks: what pictures and models have in common."""

from typing import Literal

# What the distances between landmarks are divided by. Papers differ; no function here has a default.
Normaliser = Literal["outer-eye", "inter-pupil", "box-sqrt", "box-diagonal"]
# How 3D landmarks are laid onto the true ones before their distances are measured.
Alignment = Literal["none", "rigid", "similarity", "depth"]
