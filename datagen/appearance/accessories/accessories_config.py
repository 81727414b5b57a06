"""How often people wear what."""

from dataclasses import dataclass
from typing import final

from datagen.config_limits import Share, check_limits, check_parts


@final
@dataclass(frozen=True, kw_only=True)
class AccessoriesConfig:
    """How often people wear or hold something. All numbers are shares, 0 to 1.

    Attributes:
        glasses: People with glasses.
        sunglasses: People with dark glasses.
        goggles: Glasses of either kind that are goggles for swimming or skiing.
        beard: Men with a beard or a moustache that is more than stubble.
        headwear: People with a hat, a headscarf, a helmet or the like.
        mask: People with a mask over mouth and nose, or a scarf pulled up.
        hand: People with a hand at or in front of the face.
        held: People who hold a phone, a microphone, a cup, food or the like to the face.
        thing: Pictures with a thing or another person in front of the face.
        jewellery: Women with earrings, a necklace or a piercing; a quarter as many men.
        sound: People with earphones, headphones or a headset.
        scarf: People with a scarf around the neck.
        pattern: Garments with a pattern instead of one colour.
        least_visible: Smallest share of the face that stays visible from straight ahead and from 45° to both sides.
    """

    glasses: Share = 0.20
    sunglasses: Share = 0.04
    goggles: Share = 0.01
    beard: Share = 0.30
    headwear: Share = 0.10
    mask: Share = 0.03
    hand: Share = 0.07
    held: Share = 0.03
    thing: Share = 0.05
    jewellery: Share = 0.35
    sound: Share = 0.04
    scarf: Share = 0.06
    pattern: Share = 0.25
    least_visible: Share = 0.40

    def check(self) -> None:
        """Raises a `UsageError` that names the first field with a number that nothing can be drawn from."""
        check_limits("accessories", self)
        check_parts("accessories", self, "glasses", "sunglasses")


# The preset `hard`: what hides faces, often.
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
