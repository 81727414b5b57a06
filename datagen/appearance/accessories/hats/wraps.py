"""Headscarves and hoods: cloth around a face that hides hair, ears and neck and lies on the shoulders."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from datagen.appearance.accessories.clothing.body import Body
from datagen.appearance.accessories.hats.hat_shapes import Piece
from datagen.appearance.accessories.hats.headwear_choice import Headwear
from datagen.appearance.accessories.hats.skull import Skull
from datagen.appearance.solids import Solid, sheet, tube

COLUMNS = 45  # around the opening
# Angle of the opening from straight ahead, degrees, at the top, the sides and the chin, about the skull's middle.
_TOP_DEG, _SIDE_DEG, _CHIN_DEG = 27.0, 74.0, 62.0
_BACK_DEG = 172.0
_EAR_MM = 17.0  # how far ears stand out from the skull


def wrap_pieces(kind: str, skull: Skull, body: Body, look: Headwear) -> list[Piece]:
    """A headscarf or a hood."""
    is_hood = kind == "hood"
    opening = _opening(look, is_hood)
    shell = _shell(skull, look, opening, is_hood)
    pieces: list[Piece] = [
        ("cloth", shell),
        ("cloth", cowl(body, look.seed, 1.15 if is_hood else 1.45 + 0.3 * look.size)),
    ]
    edge = shell.vertices.reshape(-1, COLUMNS, 3)[0].astype(np.float64)
    if is_hood:
        pieces.append(("cloth", tube(edge, 4.0 + 2.0 * look.size, (0.0, 0.0, 1.0), 6)))
    return pieces


def _opening(look: Headwear, is_hood: bool) -> Float[ndarray, " c"]:
    """Angle from straight ahead of the edge, radians, from the chin over the right side around."""
    spin = np.linspace(-np.pi, np.pi, COLUMNS)  # 0 the top
    up, aside = np.cos(spin), np.sin(spin) ** 2
    middle = 0.5 * (_TOP_DEG + _CHIN_DEG)
    angle = middle + 0.5 * (_TOP_DEG - _CHIN_DEG) * up + (_SIDE_DEG - middle) * aside
    angle += 5 * look.size * np.clip(up, 0, 1) + (4 if is_hood else 0)
    return np.deg2rad(angle)


def _shell(skull: Skull, look: Headwear, opening: Float[ndarray, " c"], is_hood: bool) -> Solid:
    """From the edge of the opening to the back of the head, around the line of sight."""
    share = np.linspace(0, 1, 15)[:, None] ** 1.15
    spin = np.linspace(-np.pi, np.pi, COLUMNS)[None]
    angle = opening + share * (np.deg2rad(_BACK_DEG) - opening)
    way = np.stack([np.sin(angle) * np.sin(spin), np.sin(angle) * np.cos(spin), np.cos(angle)], axis=-1)
    rise, around = np.arcsin(np.clip(way[..., 1], -1, 1)), np.arctan2(way[..., 0], way[..., 2])
    rng = np.random.default_rng(look.seed)
    folds = sum(np.sin(k * spin + rng.uniform(0, 6) + 4 * share) for k in (3, 5, 8)) / 3
    low = np.clip(-way[..., 1], 0, 1)
    base = 14 + 12 * look.size if is_hood else 4.5
    puff = 10 * look.size * np.sin(np.pi * share) if not is_hood else 12 * np.sin(np.pi * share)
    above = base * (0.45 + 0.55 * np.minimum(share * 5, 1)) + puff + 1.6 * folds * np.minimum(3 * share, 1) + 7 * low
    above = above + _EAR_MM * np.exp(-(((rise + 0.3) / 0.42) ** 2) - ((np.abs(around) - 1.5) / 0.38) ** 2)
    rise = np.maximum(rise, np.deg2rad(-74))
    return sheet(skull.at(rise, around, above), (12.0, 8.0), is_closed=True)


def cowl(body: Body, seed: int, length: float) -> Solid:
    """What lies around the neck and, by its length (places of the body), over the shoulders."""
    turn = np.linspace(0, 1, 49)[None]
    share = np.linspace(0, 1, 12)[:, None]
    rng = np.random.default_rng(seed + 1)
    waves = [np.sin(2 * np.pi * k * turn + rng.uniform(0, 6) + 9 * share) for k in (2, 4, 7)]
    folds = np.mean(waves, axis=0)
    place = -0.92 + share * length
    above = 11 + 12 * np.sin(np.pi * share) + 4.5 * folds * np.sin(np.pi * share)
    above = np.where(share > 0.9, 8.0, above)
    return sheet(body.at(place, turn, above), (14.0, 5.0), is_closed=True)
