"""What kinds of light there are, and how often."""

from dataclasses import dataclass
from typing import Annotated, final

from datagen.config_limits import FromZero, Limits, Range, Share, check_limits, check_weights


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

    soft_weight: FromZero = 0.55
    directional_weight: FromZero = 0.25
    studio_weight: FromZero = 0.10
    backlit_weight: FromZero = 0.04
    silhouette_weight: FromZero = 0.015
    night_weight: FromZero = 0.045
    harsh_setup_share: Share = 0.35
    mixture_share: Share = 0.3
    illuminance: Annotated[Range, Limits(0, 8, is_open=True)] = (0.45, 1.5)
    backlit_illuminance: Annotated[Range, Limits(0, 8, is_open=True)] = (0.2, 0.6)
    silhouette_illuminance: Annotated[Range, Limits(0, 8, is_open=True)] = (0.06, 0.18)
    night_illuminance: Annotated[Range, Limits(0, 8, is_open=True)] = (0.15, 0.45)
    key_share: Annotated[Range, Limits(0, 1)] = (0.35, 0.9)
    largest_lamp: FromZero = 6.0
    saturation: Annotated[Range, Limits(0, 3)] = (0.3, 1.2)
    white_balance: Annotated[Range, Limits(0, 1)] = (0.3, 1.0)
    lamp_temperature_k: Annotated[Range, Limits(1000, 40000)] = (2500.0, 10000.0)
    tilt_deg: FromZero = 7.0
    gobo_share: Share = 0.03

    def check(self) -> None:
        """Refuses numbers that nothing can be drawn from.

        Raises:
            UsageError: Names the first field that is wrong, what was expected of it and what was found.
        """
        check_limits("light", self)
        weights = ("soft", "directional", "studio", "backlit", "silhouette", "night")
        check_weights("light", self, *(f"{kind}_weight" for kind in weights))


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
