"""Distributions of light."""

from dataclasses import dataclass
from typing import Annotated, final

from datagen.config_limits import FromZero, Limits, Range, Share, check_limits, check_weights

# Kinds of light, with the weights `KIND_weight`.
KINDS = ("soft", "directional", "studio", "backlit", "silhouette", "night")


@final
@dataclass(frozen=True, kw_only=True)
class LightConfig:
    """Light on faces. The illuminance is the mean brightness of a white ball, where 1 is the white of a picture."""

    soft_weight: FromZero = 0.55  # Weight of environments without strong lamps.
    directional_weight: FromZero = 0.25  # Weight of environments with a lamp in front of the face.
    # Weight of arrangements of lamps: flash, softboxes, windows, candles, the sun at noon and others.
    studio_weight: FromZero = 0.10
    backlit_weight: FromZero = 0.04  # Weight of environments whose lamp is behind the head.
    silhouette_weight: FromZero = 0.015  # Weight of the same with hardly any light on the face.
    night_weight: FromZero = 0.045  # Weight of darkness with one dim lamp.
    # Share of the arrangements of lamps that are harsh: from below or from one side, coloured, or at noon.
    harsh_setup_share: Share = 0.35
    mixture_share: Share = 0.3  # Share of environments that are a mixture of two.
    # Smallest and largest illuminance in ordinary light.
    illuminance: Annotated[Range, Limits(0, 8, is_open=True)] = (0.45, 1.5)
    # Smallest and largest illuminance with the lamp behind the head.
    backlit_illuminance: Annotated[Range, Limits(0, 8, is_open=True)] = (0.2, 0.6)
    # Smallest and largest illuminance of silhouettes.
    silhouette_illuminance: Annotated[Range, Limits(0, 8, is_open=True)] = (0.06, 0.18)
    # Smallest and largest illuminance at night.
    night_illuminance: Annotated[Range, Limits(0, 8, is_open=True)] = (0.15, 0.45)
    # Smallest and largest share of the lamps in directional light, 0 to 1.
    key_share: Annotated[Range, Limits(0, 1)] = (0.35, 0.9)
    largest_lamp: FromZero = 6.0  # Largest brightness that one lamp gives to a white surface.
    # Smallest and largest factor on the saturation of environments.
    saturation: Annotated[Range, Limits(0, 3)] = (0.3, 1.2)
    # How much of the light's colour the camera removes: 0 nothing, 1 all of it.
    white_balance: Annotated[Range, Limits(0, 1)] = (0.3, 1.0)
    # Lowest and highest colour temperature of lamps, in K.
    lamp_temperature_k: Annotated[Range, Limits(1000, 40000)] = (2500.0, 10000.0)
    tilt_deg: FromZero = 7.0  # Standard deviation of the tilt and the roll of environments.
    # Share of lamps in front of the face that shine through blinds, leaves or the bars of a window.
    gobo_share: Share = 0.03

    def check(self) -> None:
        """Raises a `UsageError` that names the first field with a number that nothing can be drawn from."""
        check_limits("light", self)
        check_weights("light", self, *(f"{kind}_weight" for kind in KINDS))


# Rare light is more frequent, and ranges are wider.
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
