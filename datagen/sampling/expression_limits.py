"""Limits mixtures of named expressions to what faces can do and what the built-in model's mesh can show.

A mixture within the limits does not change.
"""

from collections.abc import Mapping

SIDES = ("Left", "Right")
# The weaker of two opposites is subtracted from both.
_OPPOSITES = (("jawLeft", "jawRight"), ("mouthLeft", "mouthRight"))
_OPPOSITES_OF_A_SIDE = (("eyeLookUp", "eyeLookDown"), ("eyeLookIn", "eyeLookOut"))
# Share of the opening between the lids that each shape closes at full strength, and the largest sum of these shares.
LID_CLOSURE = {"eyeBlink": 1.0, "eyeSquint": 0.35, "eyeLookDown": 0.3}
MOST_LID_CLOSURE = 1.1
# Largest strengths of the gaze to a side, and behind shut lids. Beyond them, the eyeball of the built-in model comes
# through the lids (docs/explanation/sampling.md).
LARGEST_SIDEWARD_GAZE = 0.75
LARGEST_GAZE_SHUT = 0.25
# A mouth that is both wide and round, or both rolled in and open, would fold over itself.
_ROUND = ("mouthPucker", "mouthFunnel")
_WIDE = ("mouthSmile", "mouthStretch", "mouthDimple")
_ROLLED = ("mouthRollLower", "mouthRollUpper")
# Lips that are drawn back; weaker if the jaw is open.
_DRAWN_BACK = ("mouthLowerDown", "mouthUpperUp")


def limited(strengths: Mapping[str, float]) -> dict[str, float]:
    """Returns the mixture within the limits, with strengths above 0 and up to 1."""
    mixture = {name: min(value, 1.0) for name, value in strengths.items() if value > 0}
    for first, second in _OPPOSITES:
        _keep_the_stronger(mixture, first, second)
    for side in SIDES:
        for first, second in _OPPOSITES_OF_A_SIDE:
            _keep_the_stronger(mixture, first + side, second + side)
        _limit_lids(mixture, side)
    _limit_mouth(mixture)
    return {name: value for name, value in mixture.items() if value > 0}


def _keep_the_stronger(mixture: dict[str, float], first: str, second: str) -> None:
    common = min(mixture.get(first, 0.0), mixture.get(second, 0.0))
    if common:
        mixture[first] -= common
        mixture[second] -= common


def _limit_lids(mixture: dict[str, float], side: str) -> None:
    for direction in ("In", "Out"):
        _cut(mixture, f"eyeLook{direction}{side}", LARGEST_SIDEWARD_GAZE)
    blink = mixture.get(f"eyeBlink{side}", 0.0)
    _cut(mixture, f"eyeWide{side}", max(0.0, 1 - 2 * blink))
    for direction in ("In", "Out", "Up", "Down"):
        _cut(mixture, f"eyeLook{direction}{side}", 1 - (1 - LARGEST_GAZE_SHUT) * blink)
    # A blink weakens the other shapes that close the lids, so that the lids do not pass each other.
    others = {name: mixture.get(name + side, 0.0) for name in ("eyeSquint", "eyeLookDown")}
    closed = sum(LID_CLOSURE[name] * value for name, value in others.items())
    room = MOST_LID_CLOSURE - blink
    if closed > room:
        for name, value in others.items():
            if value:
                mixture[name + side] = value * max(room, 0.0) / closed


def _limit_mouth(mixture: dict[str, float]) -> None:
    tongue = mixture.get("tongueOut", 0.0)
    if tongue:
        mixture["jawOpen"] = max(mixture.get("jawOpen", 0.0), 0.15 + 0.4 * tongue)
    jaw = mixture.get("jawOpen", 0.0)
    _cut(mixture, "mouthClose", 0.0 if tongue else jaw)
    is_open = max(jaw - mixture.get("mouthClose", 0.0), 0.0)
    roundness = max(mixture.get(name, 0.0) for name in _ROUND)
    for name in _of_both_sides(_WIDE):
        _cut(mixture, name, 1 - 0.8 * roundness)
    for name in _ROLLED:
        _cut(mixture, name, 1 - 0.8 * min(is_open, 1.0))
    for name in _of_both_sides(_DRAWN_BACK):
        _cut(mixture, name, 1 - 0.4 * is_open)
    for name in ("jawLeft", "jawRight", "jawForward"):
        _cut(mixture, name, 1 - 0.6 * is_open)
    _cut(mixture, "cheekPuff", 1 - is_open)


def _of_both_sides(names: tuple[str, ...]) -> list[str]:
    return [name + side for name in names for side in SIDES]


def _cut(mixture: dict[str, float], name: str, largest: float) -> None:
    if name in mixture:
        mixture[name] = min(mixture[name], largest)
