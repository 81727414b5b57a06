"""Hats, caps, helmets, turbans, scarves over the head: which one, and how much hair it hides."""

import numpy as np

from datagen.appearance.accessories.clothing.body import Body
from datagen.appearance.accessories.colours import cloth, smooth
from datagen.appearance.accessories.hats.fedora import FEDORA_CROWN, LARGEST_TILT_DEG, fedora_mesh
from datagen.appearance.accessories.hats.hat_shapes import Fit, HatPiece, hat_pieces
from datagen.appearance.accessories.hats.headwear_choice import WRAPS, Headwear
from datagen.appearance.accessories.hats.skull import CENTRE, fit_skull
from datagen.appearance.accessories.hats.wraps import wrap_pieces
from datagen.appearance.hair.shape import CrownPlane
from datagen.appearance.scene import Material, PosedHead, SceneMesh
from datagen.appearance.solids import scene_mesh

# How far below the hair line the rim is, degrees about the middle of the skull: front, sides, back.
_RIMS = {
    "cap": (24.0, 9.0, -8.0),
    "beanie": (26.0, -2.0, -22.0),
    "brimmed": (26.0, 11.0, -4.0),
    "helmet": (24.0, -4.0, -22.0),
    "turban": (30.0, 4.0, -14.0),
    "bandana": (27.0, 8.0, -14.0),
    "headband": (27.0, 10.0, -12.0),
    "crown": (38.0, 34.0, 26.0),
    "party": (62.0, 60.0, 58.0),
}


def headwear_meshes(hat: Headwear, head: PosedHead, body: Body) -> list[SceneMesh]:
    """The pieces of a hat on a head."""
    if hat.kind == "fedora":
        forward_deg = float(np.clip(hat.lift_deg, -LARGEST_TILT_DEG, LARGEST_TILT_DEG))
        return [fedora_mesh(head, hat.colour, -forward_deg)]
    if hat.kind in WRAPS:
        pieces = wrap_pieces(hat.kind, fit_skull(head, with_expression=True), body, hat)
    else:
        pieces = hat_pieces(hat.kind, fit_skull(head), _fit(hat), hat)
    return [scene_mesh(f"headwear/{hat.kind}", "headwear", made, _material(hat, piece)) for piece, made in pieces]


def crown_plane(hat: Headwear) -> CrownPlane | None:
    """Above which hair is hidden; None where a hat lies on top of all hair."""
    if hat.kind in WRAPS:
        return CrownPlane((0.0, -400.0, 0.0), (0.0, 1.0, 0.0))
    if hat.kind == "fedora":
        return FEDORA_CROWN
    if hat.kind in ("headband", "crown", "party"):
        return None
    fit = _fit(hat)
    radius = {0.0: 98.0, np.pi: 92.0, np.pi / 2: 74.0}
    front, back, side = (
        CENTRE + reach * np.array([np.sin(turn), np.tan(fit.rim(np.array([turn]))[0]), np.cos(turn)])
        for turn, reach in radius.items()
    )
    ahead = front - back
    middle = 0.5 * (side + 0.5 * (front + back))
    normal = np.array([0.0, ahead[2], -ahead[1]]) / np.hypot(ahead[1], ahead[2])
    x, y, z = (round(float(part), 3) for part in (0.0, middle[1], 0.5 * (front[2] + back[2])))
    return CrownPlane((x, y, z), (0.0, round(float(normal[1]), 5), round(float(normal[2]), 5)))


def _fit(hat: Headwear) -> Fit:
    front, side, back = _RIMS[hat.kind]
    return Fit(front + hat.lift_deg, side + 0.7 * hat.lift_deg, back + 0.3 * hat.lift_deg, hat.turn_deg, hat.tilt_deg)


def _material(hat: Headwear, piece: HatPiece) -> Material:
    if piece == "hard":
        return smooth(hat.colour, 0.3 if hat.kind == "helmet" else 0.25, 0.05 if hat.kind != "crown" else 0.6)
    if piece == "visor":
        return Material(
            kind="glass",
            colour=(0.02, 0.02, 0.02),
            alpha=0.08 + 0.3 * hat.size,
            numbers=(0.1, 0, 0, 0),
            is_blended=True,
        )
    if piece == "second":
        return cloth("jersey", hat.second, hat.colour)
    if piece == "logo":
        return cloth("print", hat.colour, hat.second)
    return cloth(hat.weave, hat.colour, hat.second, 0.55 if hat.weave == "leather" else 0.88)
