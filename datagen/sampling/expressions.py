"""Draws natural expressions as mixtures of named expressions."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from datagen.sampling.expression_limits import SIDES, limited
from datagen.sampling.expression_recipes import EMOTIONS, EXTREMES, MAYBE, SMILES, SPEECH, Recipe
from datagen.sampling.sampling_config import GeometryConfig
from pix2face.models.morphable_model import MorphableModel

# The attribute of a sample that holds the strengths, as JSON.
NAMED_EXPRESSIONS = "named_expressions"
# Decimals of the stored strengths.
_DIGITS = 2


@final
@dataclass(frozen=True)
class DrawnExpression:
    """An expression and how it was drawn."""

    kind: str  # `neutral`, `emotion/anger`, `speech/a+o`, `extreme/yawn` or `mixture`
    strengths: Mapping[str, float]  # of the active named expressions, above 0 to 1


def draw_named_expression(rng: np.random.Generator, config: GeometryConfig, names: Sequence[str]) -> DrawnExpression:
    """Draws a mixture of the named expressions `names` of a model. Shapes that the model lacks are left out."""
    kind, wanted = _draw_face(rng, config, names)
    for name, value in _draw_eyes(rng, config).items():
        wanted[name] = max(value, wanted.get(name, 0.0))
    known = {name: value for name, value in limited(wanted).items() if name in set(names)}
    rounded = {name: round(known[name], _DIGITS) for name in sorted(known)}
    return DrawnExpression(kind, {name: value for name, value in rounded.items() if value > 0})


def knows_recipes(names: Sequence[str]) -> bool:
    """Whether a model has more than half of the named expressions that the recipes of emotions use."""
    wanted = {name for recipe in EMOTIONS.values() for name in recipe}
    return len(wanted & {*names, *map(without_side, names)}) > len(wanted) / 2


def expression_of(model: MorphableModel, strengths: Mapping[str, float]) -> Float64[ndarray, " e"]:
    """Returns the expression coefficients, in standard deviations, of a mixture of named expressions."""
    total = np.zeros(model.n_expression)
    for name, strength in strengths.items():
        total += strength * model.named_expressions[name]
    return total


def strengths_to_text(strengths: Mapping[str, float]) -> str:
    """Formats strengths as JSON, as they are stored in a sample's attributes."""
    return json.dumps(dict(strengths), sort_keys=True, separators=(",", ":"))


def strengths_of(attributes: Mapping[str, str | float]) -> dict[str, float]:
    """Returns the strengths of named expressions in a sample's attributes; empty if there are none."""
    text = attributes.get(NAMED_EXPRESSIONS)
    return {name: float(value) for name, value in json.loads(text).items()} if isinstance(text, str) else {}


def mirrored_strengths(strengths: Mapping[str, float]) -> dict[str, float]:
    """Returns the strengths of the mirrored face."""
    return {_other_side(name): value for name, value in strengths.items()}


def without_side(name: str) -> str:
    """Removes the side of the face from a named expression. Expressions such as `jawLeft` keep their name."""
    if name in _UNPAIRED:
        return name
    return name.removesuffix("Left").removesuffix("Right")


def _draw_face(rng: np.random.Generator, config: GeometryConfig, names: Sequence[str]) -> tuple[str, dict[str, float]]:
    """Draws everything except gaze and lids."""
    shares = np.array([config.neutral_share, config.emotion_share, config.speech_share, config.extreme_share])
    place = int(np.searchsorted(np.cumsum(shares), rng.random(), side="right"))
    if place == 0:
        return "neutral", {}
    if place == 1:
        is_smile = rng.random() < config.smile_share
        kind = str(rng.choice([name for name in EMOTIONS if (name in SMILES) == is_smile]))
        recipe = dict(EMOTIONS[kind])
        for name, value in MAYBE[kind].items():
            if rng.random() < 0.5:
                recipe[name] = recipe.get(name, 0.0) + value
        return f"emotion/{kind}", _performed(rng, config, recipe, 0.1 + 0.9 * float(rng.beta(1.8, 1.2)))
    if place == 2:
        return _draw_speech(rng, config)
    if place == 3:
        kind = str(rng.choice(list(EXTREMES)))
        return f"extreme/{kind}", _performed(rng, config, EXTREMES[kind], float(rng.uniform(0.6, 1.0)))
    return "mixture", _draw_mixture(rng, config, names)


def _draw_speech(rng: np.random.Generator, config: GeometryConfig) -> tuple[str, dict[str, float]]:
    last, following = (str(name) for name in rng.choice(list(SPEECH), 2, replace=False))
    share, loudness = rng.uniform(0, 1), rng.uniform(0.5, 1.3)
    recipe: dict[str, float] = {}
    for weight, sound in ((1 - share, last), (share, following)):
        for name, value in SPEECH[sound].items():
            recipe[name] = recipe.get(name, 0.0) + weight * value
    spoken = _performed(rng, config, recipe, float(loudness))
    brows = rng.choice(["browInnerUp", "browOuterUp", "browDown", ""], p=[0.2, 0.15, 0.15, 0.5])
    mood = {str(brows): float(rng.uniform(0.2, 0.7))} if brows else {}
    if rng.random() < 0.3:  # people smile and frown while they speak
        emotion = EMOTIONS[str(rng.choice(["smile", "joy", "anger", "sadness", "surprise"]))]
        mood |= {name: value for name, value in emotion.items() if not name.startswith(("mouth", "jaw"))}
    for name, value in _performed(rng, config, mood, float(rng.uniform(0.3, 0.9))).items():
        spoken[name] = spoken.get(name, 0.0) + value
    return f"speech/{last}+{following}", spoken


def _draw_mixture(rng: np.random.Generator, config: GeometryConfig, names: Sequence[str]) -> dict[str, float]:
    """Draws two to six shapes of any kind, most of them weak."""
    roots = sorted({without_side(name) for name in names if not name.startswith("eyeLook")})
    if not roots:
        return {}
    count = min(int(rng.integers(2, 7)), len(roots))
    recipe = {str(root): float(rng.beta(1.2, 2.2)) for root in rng.choice(roots, count, replace=False)}
    return _performed(rng, config, recipe, 1.0)


def _performed(rng: np.random.Generator, config: GeometryConfig, recipe: Recipe, intensity: float) -> dict[str, float]:
    """Varies the strengths of a recipe, mostly alike on both sides, and swaps the sides of half of the faces."""
    is_swapped = rng.random() < 0.5
    tilt = float(rng.normal(0, config.asymmetry))
    if rng.random() < config.one_sided_share:
        tilt = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.4, 0.9))
    factors = {"Left": min(1.0, 1 + tilt), "Right": min(1.0, 1 - tilt)}
    mixture: dict[str, float] = {}
    for name, value in recipe.items():
        strength = intensity * value * float(np.clip(rng.normal(1, 0.2), 0.3, 1.6))
        if name in _UNPAIRED or name.endswith(SIDES):
            mixture[_other_side(name) if is_swapped else name] = strength
        else:
            mixture |= {name + side: strength * factors[side] for side in SIDES}
    return mixture


def _draw_eyes(rng: np.random.Generator, config: GeometryConfig) -> dict[str, float]:
    """Draws the common gaze of both eyes, lids that follow it, and lids that close."""
    eyes: dict[str, float] = {}
    if rng.random() < config.gaze_share:
        right, up = (float(value) for value in np.clip(rng.normal(0, [0.38, 0.32]), -1, 1))
        # To the subject's right, the right eye looks outward, the left eye inward.
        outward, inward = ("Right", "Left") if right > 0 else ("Left", "Right")
        eyes |= {f"eyeLookOut{outward}": abs(right), f"eyeLookIn{inward}": abs(right)}
        eyes |= {f"eyeLook{'Up' if up > 0 else 'Down'}{side}": abs(up) for side in SIDES}
        # The upper lids follow the gaze, since they rest on the cornea.
        lids = ("eyeWide", 0.25 * up) if up > 0 else ("eyeBlink", -0.2 * up)
        eyes |= {lids[0] + side: lids[1] for side in SIDES}
    for side, closed in zip(SIDES, _draw_lids(rng, config), strict=True):
        eyes[f"eyeBlink{side}"] = min(1.0, eyes.get(f"eyeBlink{side}", 0.0) + closed)
    return eyes


def _draw_lids(rng: np.random.Generator, config: GeometryConfig) -> tuple[float, float]:
    """Draws how far the left and the right eye are closed."""
    kind = rng.random()
    if kind < config.shut_share:
        return 1.0, 1.0
    if kind < config.shut_share + config.wink_share:
        other = float(rng.uniform(0, 0.25))
        return (1.0, other) if rng.random() < 0.5 else (other, 1.0)
    if kind < config.shut_share + config.wink_share + config.half_shut_share:
        closed = float(rng.uniform(0.15, 0.7))
        return closed, closed * float(rng.uniform(0.9, 1.0))
    closed = float(rng.exponential(0.04))  # slightly drooping lids
    return closed, closed


def _other_side(name: str) -> str:
    for side, other in (SIDES, SIDES[::-1]):
        if name.endswith(side):
            return name.removesuffix(side) + other
    return name


# Shapes that are no pair of a left and a right one: those in the middle, and jaw or mouth to one side.
_UNPAIRED = frozenset(
    (
        "browInnerUp",
        "cheekPuff",
        *("jawForward", "jawLeft", "jawOpen", "jawRight"),
        *("mouthClose", "mouthFunnel", "mouthLeft", "mouthPucker", "mouthRight"),
        *("mouthRollLower", "mouthRollUpper", "mouthShrugLower", "mouthShrugUpper"),
        "tongueOut",
    )
)
