"""Where things lie in the textures of the skin: what the script that packs them and the shader agree on."""

# The part of MakeHuman's uv square that holds the outside of the head: u from, u to, v from, v to (v upward).
ATLAS_UV = (325 / 512, 1.0, 77 / 512, 417 / 512)
ATLAS_PX = (340, 187)  # height, width: the resolution of the 512-pixel skins
# The part that holds the face, finer: wrinkles and brows.
DETAILS_UV = (0.76, 0.985, 0.315, 0.651)
DETAILS_PX = (516, 346)
# A skin is stored relative to its own mean colour (linear): byte = 255 sqrt(ratio / LARGEST_RATIO).
LARGEST_RATIO = 2.25
# The gradient of the wrinkles' depth, per mm, that the bytes 0 and 255 stand for.
LARGEST_GRADIENT = 1.0
NOISE_PX, IRIS_PX = 256, 96

AGES = ("young", "middleage", "old")
ORIGINS = ("african", "asian", "caucasian")
SEXES = ("female", "male")
SKINS = tuple(f"{age}_{origin}_{sex}" for age in AGES for origin in ORIGINS for sex in SEXES)
IRISES = ("blue", "bluegreen", "brown", "brownlight", "deepblue", "green", "grey", "ice", "lightblue")
