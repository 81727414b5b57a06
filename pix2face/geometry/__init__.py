"""Cameras, crops, maps and landmarks: what pictures and models have in common."""
