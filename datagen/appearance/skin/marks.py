"""Single marks on a face: moles, blemishes, acne and scars."""

from dataclasses import dataclass
from typing import final

import numpy as np

from datagen.appearance.person import Person
from datagen.appearance.skin.skin_config import SkinConfig
from datagen.random_streams import Triple, rounded, triple

MAX_MARKS = 12  # as in skin.glsl


@final
@dataclass(frozen=True, kw_only=True)
class Mark:
    """A round spot."""

    kind: str  # `mole`, `acne`, `blemish` or `scar`
    place: Triple  # on the mean head, mm
    radius_mm: float
    melanin: float  # added to that of the skin
    haemoglobin: float  # added to that of the skin
    height: float  # height of the bump; negative for a dent
    core: float  # share of the radius with full strength


def draw_marks(rng: np.random.Generator, config: SkinConfig, person: Person) -> tuple[Mark, ...]:
    """Draws the marks of one face, at most `MAX_MARKS`."""
    marks = [_mole(rng) for _ in range(int(rng.poisson(config.moles)))]
    has_acne = rng.random() < config.acne_share * (1.0 if person.age_years < 30 else 0.25)
    marks += [_acne(rng, person) for _ in range(int(rng.integers(3, 9)) if has_acne else 0)]
    marks += [_blemish(rng) for _ in range(int(rng.poisson(0.6)))]
    if rng.random() < config.scar_share:
        marks += _scar(rng)
    order = rng.permutation(len(marks))
    return tuple(marks[k] for k in order[:MAX_MARKS])


def _place(rng: np.random.Generator) -> tuple[float, float]:
    """Draws a place on the front of the mean face, outside eyes and lips: x, y in mm."""
    while True:
        x, y = rng.uniform(-66, 66), rng.uniform(-84, 92)
        in_eye = np.hypot((abs(x) - 31) / 17, (y - 27) / 9) < 1
        on_lips = np.hypot(x / 27, (y + 43) / 12) < 1
        if np.hypot(x / 68, (y - 5) / 95) < 1 and not in_eye and not on_lips:
            return float(x), float(y)


def _on_face(x: float, y: float) -> tuple[float, float, float]:
    """Adds the approximate depth of the mean face. An error of some mm does not matter to marks."""
    z = 103.0 - 0.0165 * x * x - 0.0015 * (y - 10.0) ** 2 + 14.0 * np.exp(-((x / 11) ** 2) - ((y + 8) / 16) ** 2)
    return triple((x, y, z), 2)


def _mark(kind: str, xy: tuple[float, float], core: float, **numbers: float) -> Mark:
    return Mark(kind=kind, place=_on_face(*xy), core=core, **{name: rounded(v, 4) for name, v in numbers.items()})


def _mole(rng: np.random.Generator) -> Mark:
    radius = float(np.clip(rng.lognormal(0.25, 0.4), 0.7, 4.5))
    place, melanin, height = _place(rng), rng.uniform(0.25, 0.9), rng.uniform(0, 0.9)
    return _mark("mole", place, 0.55, radius_mm=radius, melanin=melanin, haemoglobin=0.1, height=height)


def _acne(rng: np.random.Generator, person: Person) -> Mark:
    radius, red, height = rng.uniform(1.2, 3.2), rng.uniform(0.25, 0.8), rng.uniform(0.2, 1.0)
    melanin = 0.05 * person.melanin
    return _mark("acne", _place(rng), 0.2, radius_mm=radius, melanin=melanin, haemoglobin=red, height=height)


def _blemish(rng: np.random.Generator) -> Mark:
    radius, melanin, red = rng.uniform(2, 7), rng.uniform(-0.03, 0.12), rng.uniform(0, 0.25)
    return _mark("blemish", _place(rng), 0.1, radius_mm=radius, melanin=melanin, haemoglobin=red, height=0.0)


def _scar(rng: np.random.Generator) -> list[Mark]:
    """Draws a row of pale or pink spots."""
    x, y = _place(rng)
    turn, length = rng.uniform(0, np.pi), rng.uniform(4, 14)
    melanin, red, height = rng.uniform(-0.12, 0.02), rng.uniform(-0.1, 0.3), rng.uniform(-0.6, 0.6)
    radius = (0.22 * length + 0.4) * 0.6
    places = [(x + s * np.cos(turn), y + s * np.sin(turn)) for s in np.linspace(-0.5, 0.5, 5) * length]
    return [
        _mark("scar", place, 0.3, radius_mm=radius, melanin=melanin, haemoglobin=red, height=height) for place in places
    ]
