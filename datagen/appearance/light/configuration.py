"""What kinds of light there are, and how often."""

from dataclasses import dataclass, fields
from typing import final

from pix2face.errors import UsageError

Range = tuple[float, float]


@final
@dataclass(frozen=True, kw_only=True)
class LightConfig:
    """Light on faces. Illuminances are of a white ball, seen by the camera: at 1 it is as white as can be shown.

    Attributes:
        soft_weight: Weight of environments without strong lamps.
        directional_weight: Of environments with a lamp before the face.
        studio_weight: Of arrangements of lamps: flash, softboxes, windows, candles, the sun at noon, ...
        backlit_weight: Of environments whose lamp is behind the head.
        silhouette_weight: Of the same with next to no light on the face.
        night_weight: Of the dark with one dim lamp.
        harsh_setup_share: How many of the arrangements of lamps are harsh: from below or one side, coloured, at noon.
        mixture_share: How many environments are two, one over the other.
        illuminance: Smallest and largest in ordinary light.
        backlit_illuminance: With the lamp behind the head.
        silhouette_illuminance: Of silhouettes.
        night_illuminance: At night.
        key_share: Smallest and largest share of lamps in directional light, 0..1.
        largest_lamp: No lamp makes a white surface brighter than this.
        saturation: Factor of the environments' saturation.
        white_balance: How much of the light's colour the camera takes out: 0 nothing, 1 all.
        lamp_temperature_k: Coldest and hottest lamp in K.
        tilt_deg: Standard deviation of the tilt and the roll of environments.
        gobo_share: How often a lamp before the face shines through blinds, leaves or a window's bars.
    """

    soft_weight: float = 0.55
    directional_weight: float = 0.25
    studio_weight: float = 0.10
    backlit_weight: float = 0.04
    silhouette_weight: float = 0.015
    night_weight: float = 0.045
    harsh_setup_share: float = 0.35
    mixture_share: float = 0.3
    illuminance: Range = (0.45, 1.5)
    backlit_illuminance: Range = (0.2, 0.6)
    silhouette_illuminance: Range = (0.06, 0.18)
    night_illuminance: Range = (0.15, 0.45)
    key_share: Range = (0.35, 0.9)
    largest_lamp: float = 6.0
    saturation: Range = (0.3, 1.2)
    white_balance: Range = (0.3, 1.0)
    lamp_temperature_k: Range = (2500.0, 10000.0)
    tilt_deg: float = 7.0
    gobo_share: float = 0.03

    def check(self) -> None:
        """Raises UsageError where a number makes no sense, naming it."""
        weights = [field.name for field in fields(self) if field.name.endswith("_weight")]
        for name in [*weights, "tilt_deg", "largest_lamp"]:
            _expect(name, getattr(self, name) >= 0, "0 or more", getattr(self, name))
        _expect("soft_weight to night_weight", sum(getattr(self, name) for name in weights) > 0, "one above 0", "none")
        for name in ("harsh_setup_share", "mixture_share", "gobo_share"):
            value = getattr(self, name)
            _expect(name, 0 <= value <= 1, "0 to 1", value)
        for name, largest in _RANGES.items():
            low, high = getattr(self, name)
            _expect(name, 0 <= low <= high <= largest, f"[low, high] in 0 to {largest:g}", [low, high])
        for name in ("illuminance", "backlit_illuminance", "silhouette_illuminance", "night_illuminance"):
            _expect(name, getattr(self, name)[0] > 0, "more than 0", getattr(self, name))
        low, high = self.lamp_temperature_k
        _expect("lamp_temperature_k", 1000 <= low <= high, "[low, high] from 1000", [low, high])


_RANGES = {
    "illuminance": 8.0,
    "backlit_illuminance": 8.0,
    "silhouette_illuminance": 8.0,
    "night_illuminance": 8.0,
    "key_share": 1.0,
    "saturation": 3.0,
    "white_balance": 1.0,
    "lamp_temperature_k": 40000.0,
}

# Rarer things more often, extremes wider.
HARD_LIGHT = LightConfig(
    soft_weight=0.22,
    directional_weight=0.28,
    studio_weight=0.2,
    backlit_weight=0.12,
    silhouette_weight=0.06,
    night_weight=0.12,
    harsh_setup_share=0.65,
    illuminance=(0.25, 2.0),
    backlit_illuminance=(0.12, 0.6),
    silhouette_illuminance=(0.03, 0.15),
    night_illuminance=(0.08, 0.4),
    key_share=(0.5, 0.97),
    largest_lamp=8.0,
    saturation=(0.0, 1.6),
    white_balance=(0.0, 1.0),
    lamp_temperature_k=(2000.0, 12000.0),
    tilt_deg=12.0,
    gobo_share=0.2,
)


def _expect(name: str, holds: bool, expected: str, found: object) -> None:
    if not holds:
        raise UsageError(f"light.{name}: expected {expected}, found {found}; change it in the file of the appearance")
