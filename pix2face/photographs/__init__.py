"""Photographs in; maps, fits, meshes and pages out: the interface in Python and the commands."""
