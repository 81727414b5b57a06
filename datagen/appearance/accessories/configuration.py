"""How often people wear what."""

from dataclasses import dataclass, fields
from typing import final

from pix2face.errors import UsageError


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

    glasses: float = 0.20
    sunglasses: float = 0.04
    goggles: float = 0.01
    beard: float = 0.30
    headwear: float = 0.10
    mask: float = 0.03
    hand: float = 0.07
    held: float = 0.03
    thing: float = 0.05
    jewellery: float = 0.35
    sound: float = 0.04
    scarf: float = 0.06
    pattern: float = 0.25
    least_visible: float = 0.40

    def check(self) -> None:
        """Checks every share.

        Raises:
            UsageError: One is no share, or those of glasses exceed 1 together.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0 <= value <= 1:
                raise UsageError(f"accessories.{field.name}: expected a share from 0 to 1, found {value}")
        if self.glasses + self.sunglasses > 1:
            raise UsageError(
                "accessories.glasses, accessories.sunglasses: expected shares whose sum is at most 1, "
                f"found {self.glasses} and {self.sunglasses}"
            )


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
