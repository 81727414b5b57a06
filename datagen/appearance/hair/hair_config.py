"""Distributions of hair, brows and lashes."""

from dataclasses import dataclass
from typing import Annotated, final

from datagen.config_limits import FromZero, Limits, Range, Share, check_limits


@final
@dataclass(frozen=True, kw_only=True)
class HairConfig:
    """Shares and ranges of hair. Styles also depend on sex, age and origin, but each can occur with any."""

    # Share of men whose head is bald, shaved or cropped, which is painted on the scalp; a third of it for women.
    no_mesh_share: Share = 0.24
    # Share of heads whose strands hang over forehead and cheeks as far as the style allows; all other heads have them
    # combed aside.
    over_face_share: Share = 0.15
    covering_factor: FromZero = 0.6  # Factor on the weight of styles that hang over shoulders and cheeks.
    mirrored_share: Share = 0.5  # Share of styles that are mirrored left to right.
    cap_share: Share = 0.15  # Share of styles with gaps at the crown that get short hair below.
    cut_share: Share = 0.4  # Share of long hair that is cut off at some height.
    # Smallest and largest factor on the length of what hangs below the ears.
    length: Annotated[Range, Limits(0, is_open=True)] = (0.6, 1.1)
    # Smallest and largest factor on the distance from the scalp.
    volume: Annotated[Range, Limits(0, is_open=True)] = (0.75, 1.25)
    # Standard deviation of how far wind or a tilt of the head moves the tips of 10 cm of hair sideways.
    sway_mm: FromZero = 6.0
    density: Annotated[Range, Limits(0, is_open=True)] = (0.8, 1.15)  # Smallest and largest density; 1 is as modelled.
    # Share of men of 60 whose hair is thin at the crown; smaller before, larger after, a quarter for women.
    thinning_share: Share = 0.4
    dyed_share: Share = 0.12  # Share of heads in a natural colour that is not their own.
    vivid_share: Share = 0.03  # Share of heads in blue, pink, green, purple or red.
    highlights_share: Share = 0.10  # Share of heads with lighter strands or tips.
    grey_age_years: FromZero = 58.0  # Age at which half of the hair is grey, for every second person.
    # Smallest and largest density of brows; 1 is as painted.
    brow_density: Annotated[Range, Limits(0, is_open=True)] = (0.75, 1.3)
    # Smallest and largest factor on the height of brows.
    brow_thickness: Annotated[Range, Limits(0, is_open=True)] = (0.75, 1.25)
    brow_shift_mm: FromZero = 1.0  # Standard deviation of how far brows are moved up or down.
    no_brows_share: Share = 0.01  # Share of faces without brows.
    joined_brows_share: Share = 0.04  # Share of brows that meet, or nearly do.
    dyed_brows_share: Share = 0.08  # Share of brows whose colour does not follow the hair.
    mascara_share: Share = 0.5  # Share of women with mascara; a twentieth of it for men.

    def check(self) -> None:
        """Raises a `UsageError` that names the first field with a number that nothing can be drawn from."""
        check_limits("hair", self)


HARD_HAIR = HairConfig(
    no_mesh_share=0.3,
    over_face_share=0.4,
    covering_factor=1.0,
    cut_share=0.5,
    length=(0.4, 1.2),
    volume=(0.6, 1.5),
    sway_mm=14.0,
    density=(0.6, 1.2),
    dyed_share=0.2,
    vivid_share=0.1,
    highlights_share=0.2,
    brow_density=(0.35, 1.3),
    brow_thickness=(0.6, 1.45),
    brow_shift_mm=1.6,
    no_brows_share=0.04,
    joined_brows_share=0.08,
    dyed_brows_share=0.15,
)
