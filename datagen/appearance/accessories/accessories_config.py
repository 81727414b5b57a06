"""How often people wear what."""

from dataclasses import dataclass
from typing import final

from datagen.config_limits import Share, check_limits, check_parts


@final
@dataclass(frozen=True, kw_only=True)
class AccessoriesConfig:
    """Shares of pictures; the defaults are the preset ``default``.

    Attributes:
        glasses: With glasses for seeing.
        sunglasses: With dark glasses.
        goggles: Of both, that are goggles for swimming or skiing.
        beard: Of men, with a beard or a moustache that is more than stubble.
        headwear: With a hat, a scarf over the head, a helmet and the like.
        mask: With a mask before mouth and nose, or a scarf pulled up.
        hand: With a hand at or before the face.
        held: With a phone, a microphone, a cup, food and the like at the face.
        thing: With a thing or another person before the face.
        jewellery: Of women, with earrings, a necklace, a piercing; a quarter as many men.
        sound: With earphones, headphones or a headset.
        scarf: With a scarf around the neck.
        pattern: Of garments, with a pattern instead of one colour.
        least_visible: Share of the face that stays visible at least, 0..1, seen from ahead and from 45° to both sides.
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
        """Refuses numbers that nothing can be drawn from.

        Raises:
            UsageError: Names the first field that is wrong, what was expected of it and what was found.
        """
        check_limits("accessories", self)
        check_parts("accessories", self, "glasses", "sunglasses")


# The preset ``hard``: what hides faces, often.
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
