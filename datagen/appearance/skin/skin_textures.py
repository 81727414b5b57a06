"""The textures of `skin.glsl`, which `scripts/build_skin_assets.py` makes, and their layout."""

from collections.abc import Mapping
from functools import lru_cache

from datagen.appearance.asset_files import read_picture
from datagen.appearance.scene import Texture

# The part of MakeHuman's uv square with the outside of the head: smallest and largest u, then v (upward).
ATLAS_UV = (325 / 512, 1.0, 77 / 512, 417 / 512)
ATLAS_PX = (340, 187)  # height and width, at the resolution of the 512-pixel skins
# The part with the face, at a higher resolution, for wrinkles and brows.
DETAILS_UV = (0.76, 0.985, 0.315, 0.651)
DETAILS_PX = (516, 346)
# A skin is stored relative to its own mean colour (linear): byte = 255 sqrt(ratio / LARGEST_RATIO).
LARGEST_RATIO = 2.25
# Magnitude of the gradient of the wrinkles' depth, per mm, at the bytes 0 and 255.
LARGEST_GRADIENT = 1.0
NOISE_PX, IRIS_PX = 256, 96

AGES = ("young", "middleage", "old")
ORIGINS = ("african", "asian", "caucasian")
SEXES = ("female", "male")
SKINS = tuple(f"{age}_{origin}_{sex}" for age in AGES for origin in ORIGINS for sex in SEXES)
IRISES = ("blue", "bluegreen", "brown", "brownlight", "deepblue", "green", "grey", "ice", "lightblue")


@lru_cache(maxsize=1)
def skin_textures() -> Mapping[str, Texture]:
    """Reads the textures of `skin.glsl`, by the names of their samplers."""
    sizes = {
        "skin_atlas": ATLAS_PX,
        "skin_details": DETAILS_PX,
        "skin_noise": (NOISE_PX,) * 2,
        "skin_iris": (IRIS_PX,) * 2,
    }
    pictures = {name: read_picture(f"{name}.png") for name in sizes}
    layers = {name: picture.reshape(-1, *sizes[name], picture.shape[2]) for name, picture in pictures.items()}
    return {name: Texture(pixels=pixels, repeat=name == "skin_noise") for name, pixels in layers.items()}
