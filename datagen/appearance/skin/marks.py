"""Single marks on a face: moles, blemishes, acne and scars."""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy import ndarray

from datagen.appearance.person import Person
from datagen.appearance.skin.skin_config import SkinConfig
from datagen.random_streams import rounded

MAX_MARKS = 12  # as in skin.glsl


@final
@dataclass(frozen=True, kw_only=True)
class Mark:
    """A round spot."""

    kind: str  # `mole`, `acne`, `blemish` or `scar`
    place: tuple[float, float, float]  # on the mean head, mm
    radius_mm: float
    melanin: float  # added to that of the skin
    haemoglobin: float  # added to that of the skin
    height: float  # how much it bulges
    core: float  # share of the radius at full strength


def draw_marks(rng: np.random.Generator, config: SkinConfig, person: Person) -> tuple[Mark, ...]:
    """Draws the marks of one face, at most ``MAX_MARKS``."""
    marks = [_mole(rng) for _ in range(int(rng.poisson(config.moles)))]
    has_acne = rng.random() < config.acne_share * (1.0 if person.age_years < 30 else 0.25)
    marks += [_acne(rng, person) for _ in range(int(rng.integers(3, 9)) if has_acne else 0)]
    marks += [_blemish(rng) for _ in range(int(rng.poisson(0.6)))]
    if rng.random() < config.scar_share:
        marks += _scar(rng)
    order = rng.permutation(len(marks))
    return tuple(marks[k] for k in order[:MAX_MARKS])


def _place(rng: np.random.Generator) -> tuple[float, float]:
    """Anywhere on the front of the mean face but in the eyes and on the lips: x, y in mm."""
    while True:
        x, y = rng.uniform(-66, 66), rng.uniform(-84, 92)
        in_eye = np.hypot((abs(x) - 31) / 17, (y - 27) / 9) < 1
        on_lips = np.hypot(x / 27, (y + 43) / 12) < 1
        if np.hypot(x / 68, (y - 5) / 95) < 1 and not in_eye and not on_lips:
            return float(x), float(y)


def _on_face(x: float, y: float) -> tuple[float, float, float]:
    """The depth of the mean face there, roughly: marks reach some mm around their place."""
    z = 103.0 - 0.0165 * x * x - 0.0015 * (y - 10.0) ** 2 + 14.0 * np.exp(-((x / 11) ** 2) - ((y + 8) / 16) ** 2)
    return round(x, 2), round(y, 2), rounded(z, 2)


def _mark(kind: str, xy: tuple[float, float], numbers: ndarray, core: float) -> Mark:
    radius, melanin, haemoglobin, height = (rounded(value, 4) for value in numbers)
    return Mark(
        kind=kind,
        place=_on_face(*xy),
        radius_mm=radius,
        melanin=melanin,
        haemoglobin=haemoglobin,
        height=height,
        core=core,
    )


def _mole(rng: np.random.Generator) -> Mark:
    radius = float(np.clip(rng.lognormal(0.25, 0.4), 0.7, 4.5))
    return _mark("mole", _place(rng), np.array([radius, rng.uniform(0.25, 0.9), 0.1, rng.uniform(0, 0.9)]), 0.55)


def _acne(rng: np.random.Generator, person: Person) -> Mark:
    numbers = np.array([rng.uniform(1.2, 3.2), 0.05 * person.melanin, rng.uniform(0.25, 0.8), rng.uniform(0.2, 1.0)])
    return _mark("acne", _place(rng), numbers, 0.2)


def _blemish(rng: np.random.Generator) -> Mark:
    numbers = np.array([rng.uniform(2, 7), rng.uniform(-0.03, 0.12), rng.uniform(0, 0.25), 0.0])
    return _mark("blemish", _place(rng), numbers, 0.1)


def _scar(rng: np.random.Generator) -> list[Mark]:
    """A row of spots, pale or pink."""
    x, y = _place(rng)
    turn, length = rng.uniform(0, np.pi), rng.uniform(4, 14)
    melanin, haemoglobin = rng.uniform(-0.12, 0.02), rng.uniform(-0.1, 0.3)
    steps = np.linspace(-0.5, 0.5, 5) * length
    numbers = np.array([0.22 * length + 0.4, melanin, haemoglobin, rng.uniform(-0.6, 0.6)])
    return [
        _mark("scar", (float(x + s * np.cos(turn)), float(y + s * np.sin(turn))), numbers * [0.6, 1, 1, 1], 0.3)
        for s in steps
    ]
