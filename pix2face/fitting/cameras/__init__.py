"""Cameras from correspondences."""
