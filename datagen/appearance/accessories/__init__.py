"""What people wear and what is in front of their faces: glasses, beards, headwear, masks, clothes, jewellery, hands.

Code makes all geometry, in mm in the frame of the built-in model's mean head, and fits it to each head: rigid things to
the head without its expression, soft ones (beards, masks) to the head as it is. For each kind there is a frozen
dataclass of what was drawn, a function that draws it, and a function that makes its meshes.

`accessories` decides who wears what. `solids` has the shapes that everything is built from, `head_fit` the places of a
head, `materials` and `weaves` what things are made of.
"""
