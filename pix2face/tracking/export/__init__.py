"""A tracked face for other programs: glTF, USD and blendshape weights."""
