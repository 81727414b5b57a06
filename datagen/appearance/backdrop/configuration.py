"""What stands behind heads, and how often."""

from dataclasses import dataclass
from typing import final

from pix2face.errors import UsageError

Range = tuple[float, float]


@final
@dataclass(frozen=True, kw_only=True)
class BackdropConfig:
    """What is behind the head.

    Attributes:
        same_environment_weight: Weight of the environment that lights the face, where one does.
        other_environment_weight: Of any other environment.
        pattern_weight: Of walls, clutter, text, tiles, foliage, lights and other patterns of our own.
        plain_weight: Of one colour: white, black, grey, green, blue, any.
        folder: A folder of pictures, searched with all that is below it; empty for none.
        folder_share: How many backdrops come from that folder, if there is one.
        widened_share: How many views of environments take in more than the camera would, and so show more detail.
        widest_view_deg: Across the picture, of those.
        blur: Smallest and largest radius of the blur out of focus, as a share of the picture's width.
        sharp_share: How many backdrops are in focus.
        brightness: Smallest and largest brightness beside the light on the face, where it is not the environment's.
        people_share: How often other people are behind.
        most_people: How many at most; 0 for none.
    """

    same_environment_weight: float = 0.45
    other_environment_weight: float = 0.15
    pattern_weight: float = 0.32
    plain_weight: float = 0.08
    folder: str = ""
    folder_share: float = 0.6
    widened_share: float = 0.6
    widest_view_deg: float = 100.0
    blur: Range = (0.002, 0.05)
    sharp_share: float = 0.3
    brightness: Range = (0.4, 2.2)
    people_share: float = 0.06
    most_people: int = 3

    def check(self) -> None:
        """Raises UsageError where a number makes no sense, naming it."""
        weights = [getattr(self, name) for name in _WEIGHTS]
        for name, weight in zip(_WEIGHTS, weights, strict=True):
            _expect(name, weight >= 0, "0 or more", weight)
        _expect("same_environment_weight to plain_weight", sum(weights) > 0, "one above 0", weights)
        for name in ("folder_share", "widened_share", "sharp_share", "people_share"):
            value = getattr(self, name)
            _expect(name, 0 <= value <= 1, "0 to 1", value)
        _expect("widest_view_deg", 10 <= self.widest_view_deg <= 150, "10 to 150", self.widest_view_deg)
        for name, largest in (("blur", 0.5), ("brightness", 10.0)):
            low, high = getattr(self, name)
            _expect(name, 0 < low <= high <= largest, f"0 < low <= high <= {largest}", [low, high])
        _expect("most_people", 0 <= self.most_people <= 3, "0 to 3", self.most_people)


_WEIGHTS = ("same_environment_weight", "other_environment_weight", "pattern_weight", "plain_weight")

# Seldom calm, seldom out of focus.
HARD_BACKDROP = BackdropConfig(
    same_environment_weight=0.3,
    other_environment_weight=0.15,
    pattern_weight=0.47,
    blur=(0.001, 0.06),
    sharp_share=0.55,
    brightness=(0.1, 3.0),
    people_share=0.2,
)


def _expect(name: str, holds: bool, expected: str, found: object) -> None:
    if not holds:
        raise UsageError(
            f"backdrop.{name}: expected {expected}, found {found}; change it in the file of the appearance"
        )
