"""Accessories and occluders: glasses, beards, headwear, masks, clothes, jewellery, hands and objects.

All geometry is generated, in mm in the frame of the built-in model's mean head, and fitted to each head. Rigid objects
are fitted to the head without its expression, soft ones (beards, masks) to the head with it. Each kind has a frozen
dataclass of what was drawn, a function that draws it, and a function that makes its meshes.

`accessories` draws what a person wears. `head_fit` finds places of a head, and `materials` and `weaves` have materials
and their textures.
"""
