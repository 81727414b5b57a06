"""The uniforms of `skin.glsl` for one skin on one head."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from datagen.appearance.scene import PosedHead, UniformValue
from datagen.appearance.skin.make_up import FACE_PAINTS, MakeUp
from datagen.appearance.skin.marks import MAX_MARKS
from datagen.appearance.skin.skin import Skin
from datagen.appearance.skin.skin_textures import ATLAS_UV, DETAILS_UV, IRISES, SKINS
from datagen.appearance.skin.tone import DERMIS, HAEMOGLOBIN, MELANIN, SURFACE, density_of_melanin
from datagen.appearance.skin.zones import LidMargins
from pix2face.models.morphable_model import MorphableModel

# How much each expression deepens the folds of the forehead, between the brows, around the eyes, around the mouth, and
# of the lips. An expression of one side (`...Left`, `...Right`) acts on its side.
FOLDING: tuple[dict[str, float], ...] = (
    {"browInnerUp": 0.8, "browOuterUp": 0.6, "eyeWide": 0.2},
    {"browDown": 1.0, "noseSneer": 0.3},
    {"eyeSquint": 0.5, "cheekSquint": 0.6, "mouthSmile": 0.5, "eyeBlink": 0.16},
    {"mouthSmile": 0.8, "mouthDimple": 0.4, "noseSneer": 0.6, "mouthUpperUp": 0.4}
    | {"mouthStretch": 0.3, "cheekSquint": 0.3},
    {"mouthPucker": 0.8, "mouthFunnel": 0.3, "mouthPress": 0.4},
)
DEEPEST_FOLD = 1.4


def skin_uniforms(skin: Skin, head: PosedHead) -> dict[str, UniformValue]:
    """Returns the uniforms of `skin.glsl`. `SceneMaker` replaces some of those of hair by the hair that was drawn."""
    active = head.named_expressions
    folds = np.array([_folds(skin, active, side) for side in ("Left", "Right")])
    return {
        **_tone(skin),
        **_make_up(skin.make_up),
        **_hair(skin),
        **_eyes(skin, head),
        **_mouth(skin, active),
        "skin_atlas_box": _box(ATLAS_UV),
        "skin_details_box": _box(DETAILS_UV),
        "skin_wrinkles": folds[:, :4],
        "skin_lip_lines": float(folds[:, 4].mean()),
    }


def _folds(skin: Skin, active: Mapping[str, float], side: str) -> list[float]:
    """Returns the depth of each group of folds on one side of the face."""
    depths = []
    for rest, group in zip(skin.wrinkles, FOLDING, strict=True):
        folded = sum(active.get(name, active.get(f"{name}{side}", 0.0)) * share for name, share in group.items())
        depths.append(min(rest + skin.expression_folds * folded, DEEPEST_FOLD))
    return depths


def _box(uv: tuple[float, float, float, float]) -> tuple[float, ...]:
    """Returns the origin of a part of the uv square (v downward), and 1 / its extent."""
    return uv[0], 1 - uv[3], 1 / (uv[1] - uv[0]), 1 / (uv[3] - uv[2])


def _tone(skin: Skin) -> dict[str, UniformValue]:
    melanin, even = density_of_melanin(skin.melanin), 1 - skin.make_up.foundation
    seen, rough = 0.4 + 0.6 * even, 0.5 + 0.5 * even  # shares of marks and roughness that remain with foundation
    places, paints = np.zeros((2, MAX_MARKS, 4))
    for k, mark in enumerate(skin.marks):
        places[k] = [*mark.place, mark.radius_mm]
        paints[k] = [seen * mark.melanin, seen * mark.haemoglobin, mark.height, mark.core]
    return {
        "skin_surface_colour": tuple(SURFACE),
        "skin_dermis": tuple(DERMIS),
        "skin_melanin_axis": tuple(MELANIN),
        "skin_haemoglobin_axis": tuple(HAEMOGLOBIN),
        "skin_layers": tuple(float(SKINS.index(name)) for name in skin.textures),
        "skin_layer_weights": skin.texture_weights,
        "skin_contrast": skin.texture_strength * rough,
        "skin_tone": (melanin, skin.haemoglobin, skin.flush * seen, skin.under_eye * even),
        "skin_blotches": (*(even * amount for amount in skin.blotches), *skin.noise_offset),
        "skin_freckles": (skin.freckles[0], even * skin.freckles[1], even * skin.age_spots, float(skin.vitiligo)),
        "skin_finish": (skin.pores * rough, skin.oil, skin.roughness, skin.tan),
        "skin_spot_count": len(skin.marks),
        "skin_spots": places,
        "skin_spot_paint": paints,
    }


def _make_up(made: MakeUp) -> dict[str, UniformValue]:
    first, second = made.face_paint_colours
    return {
        "skin_lipstick": (*made.lipstick, made.lipstick_strength),
        "skin_eye_shadow": (*made.eye_shadow, made.eye_shadow_strength),
        "skin_blusher": (*made.blusher, made.blusher_strength),
        "skin_make_up": (made.lip_gloss, made.eyeliner),
        "skin_face_paint_a": (*first, made.face_paint_strength),
        "skin_face_paint_b": (float(FACE_PAINTS.index(made.face_paint)), *second),
    }


def _hair(skin: Skin) -> dict[str, UniformValue]:
    return {
        "skin_hair_colour": skin.hair_colour,
        "skin_beard_colour": skin.hair_colour,
        "skin_brow_colour": skin.hair_colour,
        "skin_scalp_hair": 0.8,
        "skin_brow_strength": skin.brow_strength,
        "skin_hairline": skin.hairline,
        "skin_beard": (skin.shaved_shadow, skin.stubble),
    }


def _eyes(skin: Skin, head: PosedHead) -> dict[str, UniformValue]:
    frames, arches = _lid_margins(head.model).arches(head.vertices)
    eyes = skin.eyes
    return {
        "skin_lid_frame": frames,
        "skin_lid_arch": arches,
        "skin_eye_inner": np.array([eyes.left_inner, eyes.right_inner]),
        "skin_eye_outer": np.array([eyes.left_outer, eyes.right_outer]),
        "skin_eye": (eyes.pupil, float(IRISES.index(eyes.fibres)), eyes.limbal_ring, eyes.redness),
        "skin_sclera": (*eyes.sclera, eyes.veins),
        "skin_iris_size": eyes.iris_size,
    }


def _mouth(skin: Skin, active: Mapping[str, float]) -> dict[str, UniformValue]:
    mouth = skin.mouth
    return {
        "skin_teeth": (*mouth.teeth, mouth.gaps),
        "skin_teeth_odd": (float(mouth.missing), float(mouth.gold), float(mouth.has_braces), mouth.stain),
        "skin_tongue": mouth.tongue,
        "skin_mouth_open": min(max(active.get("jawOpen", 0.0) - 0.5 * active.get("mouthClose", 0.0), 0.0), 1.0),
    }


@lru_cache(maxsize=2)
def _lid_margins(model: MorphableModel) -> LidMargins:
    return LidMargins(model)
