"""Faces through videos: detect, fill gaps, predict, fit with one identity, smooth."""
