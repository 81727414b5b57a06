"""Who is in a synthetic photograph: what skin, hair, beard and clothes have in common."""

from dataclasses import dataclass
from typing import final

import numpy as np


@final
@dataclass(frozen=True, kw_only=True)
class Person:
    """Traits that the parts of an appearance share. They say nothing about the shape of the face.

    Attributes:
        age_years: 16 to 90.
        femininity: 0 male, 1 female, between them either.
        african: Weight of the skins of African people; the three sum to 1.
        asian: Of Asian people.
        caucasian: Of Caucasian people.
        melanin: 0 the lightest skin, 1 the darkest.
    """

    age_years: float
    femininity: float
    african: float
    asian: float
    caucasian: float
    melanin: float


# Melanin of the three groups: mean and standard deviation.
_MELANIN = np.array([[0.72, 0.16], [0.36, 0.12], [0.22, 0.12]])


def draw_person(rng: np.random.Generator) -> Person:
    """Draws a person: every age, both sexes alike, mixed origins as often as not."""
    weights = rng.dirichlet(np.full(3, 0.35))
    mean, spread = weights @ _MELANIN
    femininity = float(np.clip(rng.choice([0.0, 1.0]) + rng.normal(0, 0.12), 0, 1))
    return Person(
        age_years=round(float(rng.triangular(16, 26, 76)), 1),
        femininity=round(femininity, 3),
        african=round(float(weights[0]), 3),
        asian=round(float(weights[1]), 3),
        caucasian=round(float(weights[2]), 3),
        melanin=round(float(np.clip(rng.normal(mean, spread), 0, 1)), 3),
    )
