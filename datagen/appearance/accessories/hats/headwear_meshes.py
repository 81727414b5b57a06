"""Meshes of hats, headscarves and hoods, and the hair that they hide."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from datagen.appearance.accessories.clothing.body import Body
from datagen.appearance.accessories.hats.hat_shapes import Fit, HatPiece, Piece, hat_pieces
from datagen.appearance.accessories.hats.headwear import WRAPS, Headwear
from datagen.appearance.accessories.head_fit import CENTRE, Skull, fit_skull
from datagen.appearance.accessories.materials import cloth, smooth
from datagen.appearance.hair.bound_meshes import bound_mesh, check_model
from datagen.appearance.hair.shape import CrownPlane
from datagen.appearance.scene import Colour, Material, PosedHead, SceneMesh
from datagen.appearance.solids import Solid, scene_mesh, sheet, tube
from datagen.random_streams import triple

# Elevation of the rim from the centre of the skull, degrees: front, sides, back.
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
FEDORA_CROWN = CrownPlane((0.0, 79.0, 0.0), (0.0, 0.9998, -0.02))
LARGEST_TILT_DEG = 6.0  # of a fedora; with a larger tilt, it would cut into the head or float
ROOM = 1.035  # factor on the size of a fedora, which was modelled on the skin, to make room for hair
AXIS_MM = np.array([0.0, 79.0, 5.0], dtype=np.float32)
_WRAP_COLUMNS = 45  # around the opening of a headscarf or a hood
# Angle between straight ahead and the opening at the top, the sides and the chin, from the centre of the skull.
_TOP_DEG, _SIDE_DEG, _CHIN_DEG = 27.0, 74.0, 62.0
_BACK_DEG = 172.0
_EAR_MM = 17.0  # distance of the ears' edges from the skull


def headwear_meshes(hat: Headwear, head: PosedHead, body: Body) -> list[SceneMesh]:
    """Makes the meshes of headwear on a head."""
    if hat.kind == "fedora":
        return [fedora_mesh(head, hat.colour, -float(np.clip(hat.lift_deg, -LARGEST_TILT_DEG, LARGEST_TILT_DEG)))]
    if hat.kind in WRAPS:
        pieces = wrap_pieces(fit_skull(head, with_expression=True), body, hat)
    else:
        pieces = hat_pieces(fit_skull(head), _fit(hat), hat)
    return [scene_mesh(f"headwear/{hat.kind}", "headwear", made, _material(hat, piece)) for piece, made in pieces]


def crown_plane(hat: Headwear) -> CrownPlane | None:
    """Returns the plane above which headwear hides hair; None if it is worn over the hair."""
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
    return CrownPlane(triple((0.0, middle[1], 0.5 * (front[2] + back[2])), 3), triple(normal, 5))


def _fit(hat: Headwear) -> Fit:
    front, side, back = _RIMS[hat.kind]
    return Fit(front + hat.lift_deg, side + 0.7 * hat.lift_deg, back + 0.3 * hat.lift_deg, hat.turn_deg, hat.tilt_deg)


def _material(hat: Headwear, piece: HatPiece) -> Material:
    if piece == "hard":
        return smooth(hat.colour, 0.3 if hat.kind == "helmet" else 0.25, 0.05 if hat.kind != "crown" else 0.6)
    if piece == "visor":
        dark = (0.02, 0.02, 0.02)
        return Material(kind="glass", colour=dark, alpha=0.08 + 0.3 * hat.size, numbers=(0.1, 0, 0, 0), is_blended=True)
    if piece == "second":
        return cloth("jersey", hat.second, hat.colour)
    if piece == "logo":
        return cloth("print", hat.colour, hat.second)
    return cloth(hat.weave, hat.colour, hat.second, 0.55 if hat.weave == "leather" else 0.88)


def fedora_mesh(head: PosedHead, colour: Colour, tilt_deg: float = 0.0) -> SceneMesh:
    """Makes a felt hat, which follows the head without its expression.

    Args:
        head: The head.
        colour: Linear colour.
        tilt_deg: Forward tilt, within ±`LARGEST_TILT_DEG`.

    Raises:
        InputFileError: The head is not of the built-in model.
    """
    check_model(head.model)
    mesh = bound_mesh("fedora")
    angle = np.deg2rad(tilt_deg)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    points = (mesh.mean - AXIS_MM) * np.float32(ROOM) @ turn.T.astype(np.float32) + AXIS_MM
    points += mesh.displacements(head.neutral, head.model.mean)
    return SceneMesh(
        name="headwear/fedora",
        label="headwear",
        vertices=points[mesh.point_of_vertex],
        triangles=mesh.triangles,
        uv=mesh.uv,
        normals=np.ascontiguousarray(mesh.normals[mesh.point_of_vertex]),
        material=Material(kind="object", texture="hair_fedora", colour=colour, roughness=0.9),
    )


def wrap_pieces(skull: Skull, body: Body, hat: Headwear) -> list[Piece]:
    """Makes a headscarf or a hood, which covers hair, ears, neck and shoulders."""
    is_hood = hat.kind == "hood"
    shell = _shell(skull, hat)
    made = [shell, cowl(body, hat.seed, 1.15 if is_hood else 1.45 + 0.3 * hat.size)]
    if is_hood:
        edge = shell.vertices.reshape(-1, _WRAP_COLUMNS, 3)[0].astype(np.float64)
        made.append(tube(edge, 4.0 + 2.0 * hat.size, (0.0, 0.0, 1.0), 6))
    return [("cloth", solid) for solid in made]


def _opening(hat: Headwear) -> Float[ndarray, " c"]:
    """Returns the angle between straight ahead and the edge, radians, around from the chin over the right side."""
    spin = np.linspace(-np.pi, np.pi, _WRAP_COLUMNS)  # 0 is the top
    up, aside = np.cos(spin), np.sin(spin) ** 2
    middle = 0.5 * (_TOP_DEG + _CHIN_DEG)
    angle = middle + 0.5 * (_TOP_DEG - _CHIN_DEG) * up + (_SIDE_DEG - middle) * aside
    angle += 5 * hat.size * np.clip(up, 0, 1) + (4 if hat.kind == "hood" else 0)
    return np.deg2rad(angle)


def _shell(skull: Skull, hat: Headwear) -> Solid:
    """Makes the cloth from the edge of the opening to the back of the head."""
    opening = _opening(hat)
    share = np.linspace(0, 1, 15)[:, None] ** 1.15
    spin = np.linspace(-np.pi, np.pi, _WRAP_COLUMNS)[None]
    angle = opening + share * (np.deg2rad(_BACK_DEG) - opening)
    way = np.stack([np.sin(angle) * np.sin(spin), np.sin(angle) * np.cos(spin), np.cos(angle)], axis=-1)
    rise, around = np.arcsin(np.clip(way[..., 1], -1, 1)), np.arctan2(way[..., 0], way[..., 2])
    rng = np.random.default_rng(hat.seed)
    folds = sum(np.sin(k * spin + rng.uniform(0, 6) + 4 * share) for k in (3, 5, 8)) / 3
    low = np.clip(-way[..., 1], 0, 1)
    base, puff = (14 + 12 * hat.size, 12.0) if hat.kind == "hood" else (4.5, 10 * hat.size)
    above = base * (0.45 + 0.55 * np.minimum(share * 5, 1)) + puff * np.sin(np.pi * share)
    above = above + 1.6 * folds * np.minimum(3 * share, 1) + 7 * low
    above = above + _EAR_MM * np.exp(-(((rise + 0.3) / 0.42) ** 2) - ((np.abs(around) - 1.5) / 0.38) ** 2)
    rise = np.maximum(rise, np.deg2rad(-74))
    return sheet(skull.at(rise, around, above), (12.0, 8.0), is_closed=True)


def cowl(body: Body, seed: int, length: float) -> Solid:
    """Makes the cloth around the neck and over the shoulders; `length` is in places of `Body.at`."""
    turn = np.linspace(0, 1, 49)[None]
    share = np.linspace(0, 1, 12)[:, None]
    rng = np.random.default_rng(seed + 1)
    waves = [np.sin(2 * np.pi * k * turn + rng.uniform(0, 6) + 9 * share) for k in (2, 4, 7)]
    folds = np.mean(waves, axis=0)
    place = -0.92 + share * length
    above = 11 + 12 * np.sin(np.pi * share) + 4.5 * folds * np.sin(np.pi * share)
    above = np.where(share > 0.9, 8.0, above)
    return sheet(body.at(place, turn, above), (14.0, 5.0), is_closed=True)
