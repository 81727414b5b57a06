"""Who wears what, and what stands before whom: draws it, stores it, makes its meshes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from datagen.appearance.accessories.accessories_config import AccessoriesConfig
from datagen.appearance.accessories.beard import Beard, beard_meshes, beard_textures, draw_beard
from datagen.appearance.accessories.before_face.hands import Hand, draw_hand, hand_meshes
from datagen.appearance.accessories.before_face.held import Held, draw_held, held_meshes
from datagen.appearance.accessories.before_face.masks import Mask, draw_mask, mask_meshes
from datagen.appearance.accessories.before_face.occluders import Thing, draw_thing, thing_meshes
from datagen.appearance.accessories.clothing.body import Body, fit_body
from datagen.appearance.accessories.clothing.clothes import Clothes, draw_clothes
from datagen.appearance.accessories.clothing.clothes_meshes import clothes_meshes
from datagen.appearance.accessories.coverage import mean_head, visible_share
from datagen.appearance.accessories.glasses import Glasses, draw_glasses
from datagen.appearance.accessories.glasses_meshes import glasses_meshes
from datagen.appearance.accessories.hats.headwear import WRAPS, Headwear, draw_headwear
from datagen.appearance.accessories.hats.headwear_meshes import crown_plane, headwear_meshes
from datagen.appearance.accessories.jewellery import Jewellery, draw_jewellery, jewellery_meshes
from datagen.appearance.accessories.weaves import weave_textures
from datagen.appearance.hair.shape import CrownPlane
from datagen.appearance.person import Person
from datagen.appearance.scene import Colour, PosedHead, SceneMesh, Texture

_STEP_ASIDE_MM, _FARTHEST_ASIDE_MM = 35.0, 230.0
_LEFT_OUT = ("hand", "held", "mask", "glasses", "headwear")  # in this order, where too much of a face is hidden
# Share of a face that one such thing hides at most, from measuring hundreds (the tests measure again); where the sum
# leaves enough to be seen, nothing needs to be measured.
_MOST_HIDDEN = {
    "glasses": 0.40,
    "goggles": 0.60,
    "headwear": 0.36,
    "mask": 0.50,
    "held": 0.50,
    "hand": 1.0,
    "thing": 1.0,
}
_BESIDE_MASK_MM = 2.5  # a beard below a mask is pressed flat


@final
@dataclass(frozen=True, kw_only=True)
class Accessories:
    """What one person wears, and what is before the face; None what is not there."""

    clothes: Clothes  # always there
    jewellery: Jewellery  # rings, necklaces, earphones; each kind may be `none`
    glasses: Glasses | None = None  # on the nose or pushed up into the hair
    beard: Beard | None = None  # more than stubble
    headwear: Headwear | None = None  # on or around the head
    mask: Mask | None = None  # over mouth and nose
    hand: Hand | None = None  # at or in front of the face
    held: Held | None = None  # at mouth or ear
    thing: Thing | None = None  # between the camera and the face


_KINDS: Mapping[str, type] = {
    "clothes": Clothes,
    "jewellery": Jewellery,
    "glasses": Glasses,
    "beard": Beard,
    "headwear": Headwear,
    "mask": Mask,
    "hand": Hand,
    "held": Held,
    "thing": Thing,
}


def draw_accessories(rng: np.random.Generator, config: AccessoriesConfig, person: Person) -> Accessories:
    """Draws what a person wears.

    Each part has a random stream of its own, so that another share of one changes no other.
    """
    config.check()
    streams = dict(zip(_KINDS, rng.spawn(len(_KINDS)), strict=True))
    happens = {name: float(stream.uniform()) for name, stream in streams.items()}
    glasses_share = config.glasses + config.sunglasses
    is_dark = happens["glasses"] < config.sunglasses
    drawn = Accessories(
        clothes=draw_clothes(streams["clothes"], person, config.pattern, config.scarf),
        jewellery=draw_jewellery(streams["jewellery"], person.femininity, config.sound, config.jewellery),
        glasses=draw_glasses(streams["glasses"], person, is_dark=is_dark, goggle_share=config.goggles)
        if happens["glasses"] < glasses_share
        else None,
        beard=draw_beard(streams["beard"], person)
        if person.femininity < 0.5 and happens["beard"] < config.beard
        else None,
        headwear=draw_headwear(streams["headwear"], person) if happens["headwear"] < config.headwear else None,
        mask=draw_mask(streams["mask"]) if happens["mask"] < config.mask else None,
        hand=draw_hand(streams["hand"], person.femininity) if happens["hand"] < config.hand else None,
        held=draw_held(streams["held"]) if happens["held"] < config.held else None,
        thing=draw_thing(streams["thing"]) if happens["thing"] < config.thing else None,
    )
    return _left_visible(_matched(drawn), config.least_visible)


def accessory_meshes(
    accessories: Accessories,
    head: PosedHead,
    skin_rgb: Colour,
    hair_rgb: Colour,
    head_from_torso: Float[ndarray, "3 3"],
) -> list[SceneMesh]:
    """Everything as meshes.

    Args:
        accessories: What was drawn.
        head: Whom it is fitted to.
        skin_rgb: Linear colour of the neck's skin: that of shoulders and hands.
        hair_rgb: Linear colour of the hair: that of the beard.
        head_from_torso: Turns the torso from where the head alone would have it to where it stands, model frame.
    """
    body = fit_body(head, head_from_torso, accessories.clothes.breadth)
    meshes = clothes_meshes(accessories.clothes, body, skin_rgb)
    if accessories.beard is not None:
        meshes += beard_meshes(accessories.beard, head, hair_rgb)
    meshes += jewellery_meshes(accessories.jewellery, head, body)
    return meshes + _before_the_face(accessories, head, body, skin_rgb)


def hidden_hair(accessories: Accessories) -> CrownPlane | None:
    """Above which plane a hat hides hair; None where all of it can be seen."""
    return None if accessories.headwear is None else crown_plane(accessories.headwear)


@lru_cache(maxsize=1)
def accessory_textures() -> Mapping[str, Texture]:
    """Textures of all materials here, by name."""
    return {**weave_textures(), **beard_textures()}


def _before_the_face(accessories: Accessories, head: PosedHead, body: Body, skin_rgb: Colour) -> list[SceneMesh]:
    """Meshes of what can hide a face."""
    meshes: list[SceneMesh] = []
    if accessories.glasses is not None:
        meshes += glasses_meshes(accessories.glasses, head)
    if accessories.headwear is not None:
        meshes += headwear_meshes(accessories.headwear, head, body)
    if accessories.mask is not None:
        meshes += mask_meshes(accessories.mask, head, body)
    if accessories.hand is not None:
        meshes += hand_meshes(accessories.hand, head, skin_rgb)
    if accessories.held is not None:
        meshes += held_meshes(accessories.held, head)
    if accessories.thing is not None:
        meshes += thing_meshes(accessories.thing)
    return meshes


def _matched(drawn: Accessories) -> Accessories:
    """Without what cannot be worn together."""
    changed: dict[str, Any] = {}
    hat, jewellery, glasses, beard = drawn.headwear, drawn.jewellery, drawn.glasses, drawn.beard
    if hat is not None and hat.kind in (*WRAPS, "helmet", "turban"):
        sound = jewellery.sound if jewellery.sound in ("none", "buds") else "none"
        jewellery = replace(jewellery, sound=sound)
    if hat is not None and hat.kind in WRAPS:
        jewellery = replace(jewellery, earrings="none", necklace=0, sound="none")
        changed["clothes"] = replace(drawn.clothes, scarf=0.0)
    if hat is not None and glasses is not None and (glasses.lift > 0 or glasses.rim == "goggles"):
        changed["glasses"] = replace(glasses, lift=0.0) if glasses.rim != "goggles" else None
    if drawn.mask is not None:
        jewellery = replace(jewellery, piercing="none")
        if drawn.held is not None and not drawn.held.kind.startswith("phone"):
            changed["held"] = None
        if beard is not None:
            changed["beard"] = replace(beard, thickness_mm=min(beard.thickness_mm, _BESIDE_MASK_MM), hang_mm=0.0)
    return replace(drawn, jewellery=jewellery, **changed)


def _left_visible(drawn: Accessories, least: float) -> Accessories:
    """Moves aside or leaves out what would hide too much of the face."""
    while 1 - most_hidden(drawn) < least:
        if visible_share(_before_the_face(drawn, mean_head(), _mean_body(), (0.5, 0.4, 0.3))) >= least:
            break
        drawn = _less_hidden(drawn)
    return drawn


def most_hidden(drawn: Accessories) -> float:
    """An upper bound of the share of a face that accessories hide, by what they are alone."""
    has_goggles = drawn.glasses is not None and drawn.glasses.rim == "goggles"
    kinds = ("goggles" if has_goggles else "glasses", "headwear", "mask", "held", "hand", "thing")
    return sum(_MOST_HIDDEN[kind] for kind in kinds if getattr(drawn, kind.replace("goggles", "glasses")) is not None)


def _less_hidden(drawn: Accessories) -> Accessories:
    """The next smaller change that hides less."""
    if drawn.thing is not None:
        aside = drawn.thing.aside_mm + _STEP_ASIDE_MM
        return replace(
            drawn, thing=None if aside > _FARTHEST_ASIDE_MM else replace(drawn.thing, aside_mm=round(aside, 2))
        )
    left_out: dict[str, Any] = {next(name for name in _LEFT_OUT if getattr(drawn, name) is not None): None}
    return replace(drawn, **left_out)


@lru_cache(maxsize=1)
def _mean_body() -> Body:
    return fit_body(mean_head(), np.eye(3))
