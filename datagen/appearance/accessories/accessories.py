"""Draws what a person wears and what is in front of the face, and makes the meshes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, final

import numpy as np
from jaxtyping import Float64
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

# What is removed, in this order, if too much of a face is hidden.
_REMOVED = ("hand", "held", "mask", "glasses", "headwear")
# The largest share of a face that each kind hides, measured on hundreds of examples (and again by the tests). The
# visible share need not be measured if their sum is small enough.
_MOST_HIDDEN = {
    "glasses": 0.40,
    "goggles": 0.60,
    "headwear": 0.36,
    "mask": 0.50,
    "held": 0.50,
    "hand": 1.0,
    "thing": 1.0,
}


@final
@dataclass(frozen=True, kw_only=True)
class Accessories:
    """What one person wears, and what is in front of the face."""

    clothes: Clothes
    jewellery: Jewellery  # rings, necklaces, earphones; each kind may be `none`
    glasses: Glasses | None = None  # on the nose or pushed up into the hair
    beard: Beard | None = None  # more than stubble
    headwear: Headwear | None = None  # on or around the head
    mask: Mask | None = None  # over mouth and nose
    hand: Hand | None = None  # at or in front of the face
    held: Held | None = None  # at mouth or ear
    thing: Thing | None = None  # between the camera and the face


def draw_accessories(rng: np.random.Generator, config: AccessoriesConfig, person: Person) -> Accessories:
    """Draws what a person wears.

    Each part has a random stream of its own, so that the share of one does not affect the others.
    """
    config.check()
    names = [part.name for part in fields(Accessories)]
    streams = dict(zip(names, rng.spawn(len(names)), strict=True))
    chances = {name: float(stream.uniform()) for name, stream in streams.items()}
    shares = {"glasses": config.glasses + config.sunglasses, "beard": config.beard if person.femininity < 0.5 else 0.0}
    shares |= {name: getattr(config, name) for name in ("headwear", "mask", "hand", "held", "thing")}
    is_dark = chances["glasses"] < config.sunglasses
    draw: dict[str, Callable[[np.random.Generator], Any]] = {
        "clothes": lambda stream: draw_clothes(stream, person, config.pattern, config.scarf),
        "jewellery": lambda stream: draw_jewellery(stream, person.femininity, config.sound, config.jewellery),
        "glasses": lambda stream: draw_glasses(stream, is_dark=is_dark, goggle_share=config.goggles),
        "beard": lambda stream: draw_beard(stream, person),
        "headwear": lambda stream: draw_headwear(stream, person),
        "mask": draw_mask,
        "hand": lambda stream: draw_hand(stream, person.femininity),
        "held": draw_held,
        "thing": draw_thing,
    }
    drawn = Accessories(**{name: draw[name](streams[name]) for name in names if chances[name] < shares.get(name, 1.0)})
    return _sufficiently_visible(_compatible(drawn), config.least_visible)


def accessory_meshes(
    accessories: Accessories,
    head: PosedHead,
    skin_rgb: Colour,
    hair_rgb: Colour,
    head_from_torso: Float64[ndarray, "3 3"],
) -> list[SceneMesh]:
    """Makes the meshes of all accessories on a head, and of bare neck and shoulders.

    Args:
        accessories: What was drawn.
        head: The head.
        skin_rgb: Linear colour of the skin.
        hair_rgb: Linear colour of the hair, for beards.
        head_from_torso: Rotation from a torso that is aligned with the head to the actual torso, model frame.
    """
    body = fit_body(head, head_from_torso, accessories.clothes.breadth)
    meshes = clothes_meshes(accessories.clothes, body, skin_rgb)
    if accessories.beard is not None:
        meshes += beard_meshes(accessories.beard, head, hair_rgb)
    meshes += jewellery_meshes(accessories.jewellery, head, body)
    return meshes + _before_the_face(accessories, head, body, skin_rgb)


def hidden_hair(accessories: Accessories) -> CrownPlane | None:
    """Returns the plane above which a hat hides hair; None if no hair is hidden."""
    return None if accessories.headwear is None else crown_plane(accessories.headwear)


def accessory_textures() -> Mapping[str, Texture]:
    """Returns the textures of cloth and beards, by name."""
    return {**weave_textures(), **beard_textures()}


def _before_the_face(accessories: Accessories, head: PosedHead, body: Body, skin_rgb: Colour) -> list[SceneMesh]:
    """Makes the meshes of what can hide a face."""
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


def _compatible(drawn: Accessories) -> Accessories:
    """Removes what cannot be worn together."""
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
            # A mask presses the beard flat.
            changed["beard"] = replace(beard, thickness_mm=min(beard.thickness_mm, 2.5), hang_mm=0.0)
    return replace(drawn, jewellery=jewellery, **changed)


def _sufficiently_visible(drawn: Accessories, least: float) -> Accessories:
    """Moves aside or removes what hides too much of the face."""
    while 1 - most_hidden(drawn) < least:
        if visible_share(_before_the_face(drawn, mean_head(), _mean_body(), (0.5, 0.4, 0.3))) >= least:
            break
        drawn = _less_hidden(drawn)
    return drawn


def most_hidden(drawn: Accessories) -> float:
    """Returns an upper bound of the share of a face that accessories hide, without measuring it."""
    names = ("glasses", "headwear", "mask", "held", "hand", "thing")
    kinds = [name for name in names if getattr(drawn, name) is not None]
    if drawn.glasses is not None and drawn.glasses.rim == "goggles":
        kinds[0] = "goggles"
    return sum(_MOST_HIDDEN[kind] for kind in kinds)


def _less_hidden(drawn: Accessories) -> Accessories:
    """Moves the thing aside, or removes one accessory."""
    if drawn.thing is not None:
        # Beyond 230 mm, a thing hides nothing.
        aside = drawn.thing.aside_mm + 35.0
        moved = replace(drawn.thing, aside_mm=round(aside, 2)) if aside <= 230.0 else None
        return replace(drawn, thing=moved)
    first = next(name for name in _REMOVED if getattr(drawn, name) is not None)
    return replace(drawn, **{first: None})  # type: ignore[arg-type]


@lru_cache(maxsize=1)
def _mean_body() -> Body:
    return fit_body(mean_head(), np.eye(3))
