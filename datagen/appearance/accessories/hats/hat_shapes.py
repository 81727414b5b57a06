"""Shapes of hats that sit on the skull."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal, final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from datagen.appearance.accessories.hats.headwear import Headwear
from datagen.appearance.accessories.head_fit import Skull, direction
from datagen.appearance.solids import Solid, ellipsoid, joined, lathe, sheet, tube

HatPiece = Literal["cloth", "second", "hard", "visor", "logo"]  # material of a piece
Piece = tuple[HatPiece, Solid]
COLUMNS = 41
_AROUND = np.linspace(-np.pi, np.pi, COLUMNS)[None]


@final
@dataclass(frozen=True)
class Fit:
    """The position of a hat on the skull."""

    front_deg: float  # elevation of the rim in front, as seen from the centre of the skull
    side_deg: float  # elevation at the sides
    back_deg: float  # elevation at the back
    turn_deg: float  # rotation about the vertical axis, which does not change the rim
    tilt_deg: float  # rotation to one side

    def rim(self, around: Float[ndarray, "*n"]) -> Float[ndarray, "*n"]:
        """Returns the elevation of the rim in radians; `around` is that of `head_fit.direction`."""
        ahead, aside = np.cos(around), np.sin(around) ** 2
        middle = 0.5 * (self.front_deg + self.back_deg)
        height = middle + 0.5 * (self.front_deg - self.back_deg) * ahead + (self.side_deg - middle) * aside
        return np.deg2rad(height + self.tilt_deg * np.sin(around))


def hat_pieces(skull: Skull, fit: Fit, hat: Headwear) -> list[Piece]:
    """Makes the pieces of a hat, model frame."""
    return _HATS[hat.kind](skull, fit, hat)


def _dome(skull: Skull, fit: Fit, above: Float[ndarray, "r c"], repeats: tuple[float, float] = (12.0, 5.0)) -> Solid:
    """Makes a sheet from the crown to the rim, `above` mm above the skin."""
    share = np.linspace(0, 1, len(above))[:, None]
    rise = np.pi / 2 + share * (fit.rim(_AROUND) - np.pi / 2)
    return sheet(skull.at(rise, _AROUND, above), repeats, is_closed=True)


def _shares(rows: int) -> Float[ndarray, "r c"]:
    return np.repeat(np.linspace(0, 1, rows)[:, None], COLUMNS, axis=1)


def _band(skull: Skull, fit: Fit, up_deg: float, low: float, high: float, down_deg: float = 0.0) -> Solid:
    """Makes a band along the rim, with the heights `low` at its edges and `high` in its middle above the skin."""
    share = np.array([0.0, 0.0, 0.3, 0.7, 1.0, 1.0])[:, None]
    above = np.array([0.3 * low, low, high, high, low, 0.3 * low])[:, None]
    rise = fit.rim(_AROUND) - np.deg2rad(down_deg) + np.deg2rad(up_deg) * (1 - share)
    return sheet(skull.at(rise, _AROUND, above), (14.0, 1.0), is_closed=True)


def _peak(skull: Skull, fit: Fit, hat: Headwear) -> Solid:
    """Makes the peak of a cap."""
    s = np.linspace(-1, 1, 17)[None]
    turn = np.deg2rad(fit.turn_deg)
    around = turn + np.deg2rad(58) * s
    edge = skull.at(fit.rim(around), around, 7.0)
    forward = np.array([np.sin(turn), 0.0, np.cos(turn)])
    length = (52 + 26 * hat.size) * (1 - np.abs(s) ** 2.6)[..., None]
    t = np.array([0.0, 0.35, 0.7, 1.0, 1.0, 0.7, 0.35, 0.0])[:, None, None]
    thick = np.array([0.0, 0.0, 0.0, 0.0, -2.0, -2.0, -2.0, -2.0])[:, None, None]
    bend = (6 + 8 * hat.size) * t**1.5 + 10 * t * (s**2)[..., None]
    points = edge + t * length * forward + (thick - bend) * np.array([0.0, 1.0, 0.0])
    return sheet(points, (5.0, 5.0))


def _cap(skull: Skull, fit: Fit, hat: Headwear) -> list[Piece]:
    share = _shares(11)
    front = np.exp(-((_AROUND - np.deg2rad(np.mod(fit.turn_deg + 180, 360) - 180)) ** 2))
    above = 7 + 9 * np.sin(np.pi * share) * (0.5 + front) - 2 * share
    above = above * (1 + 0.02 * np.cos(6 * _AROUND))
    pieces: list[Piece] = [("cloth", _dome(skull, fit, above)), ("cloth", _peak(skull, fit, hat))]
    crown = skull.at(np.array([np.pi / 2]), np.array([0.0]), 9.0)[0]
    pieces.append(("second", ellipsoid((6, 3, 6), 5, 8).moved(crown)))
    if hat.has_extra:
        turn = np.deg2rad(fit.turn_deg)
        u, v = np.meshgrid(np.linspace(-0.33, 0.33, 9), np.linspace(0.62, 0.22, 7))
        rim = fit.rim(turn + u)
        rise = rim + v * (np.pi / 2 - rim)
        pieces.append(("logo", sheet(skull.at(rise, turn + u, 17.5), (1.0, 1.0))))
    return pieces


def _beanie(skull: Skull, fit: Fit, hat: Headwear) -> list[Piece]:
    share = _shares(12)
    rng = np.random.default_rng(hat.seed)
    folds = np.sin(3 * _AROUND + rng.uniform(0, 6)) * np.sin(2 * np.pi * share)
    above = 5 + (6 + 26 * hat.size) * (1 - share) ** 2 + 1.5 * folds
    pieces: list[Piece] = [("cloth", _dome(skull, fit, above, (14.0, 6.0)))]
    if hat.size > 0.3:
        pieces.append(("cloth", _band(skull, fit, 18.0 + 8 * hat.size, 5.0, 9.0)))
    if hat.has_extra:
        place = skull.at(np.array([np.pi / 2]), np.array([0.0]), 11 + 26 * hat.size + 14)[0]
        pieces.append(("second", ellipsoid((20, 19, 20), 7, 12).moved(place)))
    return pieces


def _brimmed(skull: Skull, fit: Fit, hat: Headwear) -> list[Piece]:
    share = _shares(12)
    tall = 26 + 20 * (1 - hat.size)
    dent = 14 * np.exp(-((_AROUND / 0.9) ** 2)) + 6
    above = 7 + tall * np.clip((1 - share) / 0.35, 0, 1) ** 0.7 - dent * np.clip(1 - share / 0.3, 0, 1)
    edge = skull.at(fit.rim(_AROUND), _AROUND, 7.0)
    outward = np.stack([np.sin(_AROUND), 0 * _AROUND, np.cos(_AROUND)], axis=-1)
    wide = 38 + 75 * hat.size
    t = np.array([0.0, 0.25, 0.6, 1.0, 1.0, 0.6, 0.0])[:, None]
    curl = 0.28 * wide * t**2 * np.sin(_AROUND) ** 2 - 0.18 * wide * t * np.cos(_AROUND) ** 2
    lift = curl + np.array([0, 0, 0, 0, -1.5, -1.5, -1.5])[:, None]
    brim = edge + t[..., None] * wide * outward + lift[..., None] * np.array([0.0, 1.0, 0.0])
    pieces: list[Piece] = [("cloth", _dome(skull, fit, above)), ("cloth", sheet(brim, (16.0, 2.0), is_closed=True))]
    pieces.append(("second", _band(skull, fit, 14.0, 8.5, 9.5, -0.5)))
    return pieces


def _helmet(skull: Skull, fit: Fit, hat: Headwear) -> list[Piece]:
    share = _shares(12)
    above = 16 + 12 * np.sin(0.5 * np.pi * (1 - share)) + 3 * np.cos(2 * _AROUND) * (1 - share)
    shell = _dome(skull, fit, above)
    pieces: list[Piece] = [("hard", shell), ("second", _band(skull, fit, 7.0, 15.0, 18.0, 2.0))]
    for side in (-1, 1):
        rise = np.deg2rad(np.linspace(fit.side_deg, -74, 9))
        around = side * np.deg2rad(np.linspace(92, 40, 9))
        strap = skull.at(rise, around, np.linspace(10, 3.0, 9))
        pieces.append(("second", tube(strap, (1.0, 6.0), (0.0, 0.3, 1.0), 6)))
    if hat.has_extra:
        around = np.linspace(-1.2, 1.2, 17)[None]
        down = np.linspace(0, 1, 8)[:, None]
        rise = fit.rim(around) + 0.1 - down * np.deg2rad(50 + 25 * hat.size)
        pieces.append(("visor", sheet(skull.centre + 128.0 * direction(rise, around))))
    return pieces


def _turban(skull: Skull, fit: Fit, hat: Headwear) -> list[Piece]:
    share = _shares(22)
    slant = 0.22 * np.abs(_AROUND) / np.pi
    layers = 5 + int(hat.seed % 3)
    ridge = np.abs(np.sin(np.pi * layers * (share + slant))) ** 0.6
    above = 6 + (16 + 16 * hat.size) * np.sin(np.pi * np.clip(share * 0.85 + 0.1, 0, 1)) + 6 * ridge * (share > 0.12)
    return [("cloth", _dome(skull, fit, above, (10.0, 8.0)))]


def _bandana(skull: Skull, fit: Fit, hat: Headwear) -> list[Piece]:
    share = _shares(10)
    rng = np.random.default_rng(hat.seed)
    above = 4 + 1.2 * np.sin(5 * _AROUND + rng.uniform(0, 6)) * share
    pieces: list[Piece] = [("cloth", _dome(skull, fit, above)), ("cloth", _band(skull, fit, 9.0, 3.5, 6.0))]
    knot = skull.at(fit.rim(np.array([np.pi])), np.array([np.pi]), 10.0)[0]
    ends = [ellipsoid((11, 9, 9), 6, 10).moved(knot)]
    for side in (-1, 1):
        path = knot + np.array([[0, 0, 0], [side * 8, -18, -8], [side * 14, -48, -6]], dtype=np.float64)
        ends.append(tube(path, np.array([[5.0, 2.0], [13.0, 2.0], [16.0, 1.0]]), (0, 0.2, 1), 6))
    pieces.append(("cloth", joined(ends)))
    return pieces


def _crown(skull: Skull, fit: Fit, hat: Headwear) -> list[Piece]:
    around = np.linspace(-np.pi, np.pi, 61)[None]
    rim = skull.at(fit.rim(around), around, 9.0)
    tips = (np.abs(np.mod(np.arange(61), 6) - 3) / 3)[None, :, None]
    tall = 22 + 26 * hat.size
    up = np.array([0.0, 1.0, 0.0]) * tall
    flare = 0.12 * (rim - skull.centre) * [1, 0, 1]
    rows = [rim, rim + 0.5 * up + 0.5 * flare, rim + (0.5 + 0.5 * tips) * up + flare]
    return [("hard", sheet(np.concatenate(rows[::-1]), is_closed=True))]


def _party(skull: Skull, fit: Fit, hat: Headwear) -> list[Piece]:
    tall = 110 + 60 * hat.size
    cone = lathe(np.array([[0.5, tall], [26.0, 0.5 * tall], [52.0, 0.0]]), 20)
    tilt = np.deg2rad(fit.tilt_deg * 3)
    turn = np.array([[np.cos(tilt), -np.sin(tilt), 0], [np.sin(tilt), np.cos(tilt), 0], [0, 0, 1.0]])
    crown = skull.at(np.array([np.pi / 2]), np.array([0.0]), -14.0)[0]
    top = crown + turn @ np.array([0, tall, 0])
    chin = [skull.at(np.deg2rad(np.linspace(60, -74, 12)), np.full(12, side * 1.45), 2.0) for side in (-1, 1)]
    string = joined([tube(path, 0.8, (0, 0, 1), 5) for path in chin])
    pom = ellipsoid((12, 12, 12), 6, 10).moved(top)
    return [("cloth", cone.placed(turn, crown)), ("second", joined([string, pom]))]


_HATS: Mapping[str, Callable[[Skull, Fit, Headwear], list[Piece]]] = {
    "cap": _cap,
    "beanie": _beanie,
    "brimmed": _brimmed,
    "helmet": _helmet,
    "turban": _turban,
    "bandana": _bandana,
    "headband": lambda skull, fit, hat: [("cloth", _band(skull, fit, 8.0 + 18.0 * hat.size, 4.0, 7.0))],
    "crown": _crown,
    "party": _party,
}
