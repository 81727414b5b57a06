"""What is worn, and what stands before a face: glasses, beards, headwear, masks, clothes, jewellery, hands, things.

All geometry is made by code, in mm in the frame of the built-in model's mean head, and follows each head: rigid things
are fitted to points of the head without its expression, soft ones (beards, masks) to the head as it is. One module
holds one kind: a frozen dataclass of what was drawn, a function that draws it, a function that makes its meshes.

``accessories`` decides who wears what; ``solids`` has the shapes that everything is put together from, ``head_fit`` the
places of a head, ``weaves`` the textures.
"""
