"""Exports tracked faces to other programs: as glTF, USD and blendshape weights."""
