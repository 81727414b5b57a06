"""Skin, eyes and the inside of the mouth of a synthetic photograph: all that the head itself is painted with.

Three steps: ``draw_skin`` decides, once for a sample; ``head_paint`` says where on a head things are, once for a
model; ``skin_uniforms`` and ``skin_textures`` tell ``skin.glsl``.
"""

from datagen.appearance.skin.skin_config import HARD_SKIN, SkinConfig
from datagen.appearance.skin.traits import Skin, draw_skin
from datagen.appearance.skin.uniforms import skin_textures, skin_uniforms
from datagen.appearance.skin.zones import head_paint

__all__ = ["HARD_SKIN", "Skin", "SkinConfig", "draw_skin", "head_paint", "skin_textures", "skin_uniforms"]
