"""Shares of accessories."""

from dataclasses import dataclass
from typing import final

from datagen.config_limits import Share, check_limits, check_parts


@final
@dataclass(frozen=True, kw_only=True)
class AccessoriesConfig:
    """How often people wear or hold something."""

    glasses: Share = 0.20  # Share of people with glasses.
    sunglasses: Share = 0.04  # Share of people with dark glasses.
    goggles: Share = 0.01  # Share of these glasses that are goggles for swimming or skiing.
    beard: Share = 0.30  # Share of men with a beard or a moustache that is more than stubble.
    headwear: Share = 0.10  # Share of people with a hat, a headscarf, a helmet or the like.
    mask: Share = 0.03  # Share of people with a mask over mouth and nose, or a scarf pulled up.
    hand: Share = 0.07  # Share of people with a hand at or in front of the face.
    held: Share = 0.03  # Share of people who hold a phone, a microphone, a cup, food or the like to the face.
    thing: Share = 0.05  # Share of pictures with a thing or another person in front of the face.
    jewellery: Share = 0.35  # Share of women with earrings, a necklace or a piercing; a quarter of it for men.
    sound: Share = 0.04  # Share of people with earphones, headphones or a headset.
    scarf: Share = 0.06  # Share of people with a scarf around the neck.
    pattern: Share = 0.25  # Share of garments with a pattern instead of one colour.
    # Smallest share of the face that stays visible from straight ahead and from 45° to both sides.
    least_visible: Share = 0.40

    def check(self) -> None:
        """Raises a `UsageError` that names the first field with a number that nothing can be drawn from."""
        check_limits("accessories", self)
        check_parts("accessories", self, "glasses", "sunglasses")


# More of what hides faces.
HARD_ACCESSORIES = AccessoriesConfig(
    glasses=0.28,
    sunglasses=0.12,
    goggles=0.04,
    beard=0.45,
    headwear=0.28,
    mask=0.10,
    hand=0.18,
    held=0.08,
    thing=0.18,
    jewellery=0.5,
    sound=0.10,
    scarf=0.15,
    pattern=0.4,
    least_visible=0.30,
)
