"""How often which hair, brows and lashes are drawn."""

from dataclasses import dataclass
from typing import Annotated, final

from datagen.config_limits import FromZero, Limits, Range, Share, check_limits


@final
@dataclass(frozen=True, kw_only=True)
class HairConfig:
    """Shares and ranges. Styles also depend on sex, age and origin, but none is ever impossible.

    Attributes:
        no_mesh_share: Of men: heads that are bald, shaved or cropped, which is paint on the scalp alone. A third of it
            for women.
        over_face_share: Of heads whose strands hang over forehead and cheeks as far as the style has them; all others
            have them combed aside.
        covering_factor: Weight of the styles that hang down over shoulders and cheeks, against what is plausible.
        mirrored_share: Of styles turned left to right.
        cap_share: Of styles with gaps at the crown that have short hair below.
        cut_share: Of long hair cut off at some height.
        length: Factor on what hangs below the ears, from and to.
        volume: Factor on the distance from the scalp, from and to.
        sway_mm: Standard deviation of how far wind or a tilt move the tips of 10 cm of hair sideways.
        density: How full hair is, from and to; 1 is as modelled.
        thinning_share: Of men of 60 whose crown is thin; less before, more after, a quarter for women.
        dyed_share: Of heads in another natural colour than their own.
        vivid_share: Of heads in blue, pink, green, purple or red.
        highlights_share: Of heads with lighter strands or tips.
        grey_age_years: Age at which half of the hair is grey, of one person in two.
        brow_density: From and to; 1 is as painted.
        brow_thickness: Factor on the height of brows, from and to.
        brow_shift_mm: Standard deviation of how far brows are moved up or down.
        no_brows_share: Of faces without.
        joined_brows_share: Of brows that meet, or nearly.
        dyed_brows_share: Of brows in a colour that does not follow the hair.
        mascara_share: Of women; a twentieth of it for men.
    """

    no_mesh_share: Share = 0.24
    over_face_share: Share = 0.15
    covering_factor: FromZero = 0.6
    mirrored_share: Share = 0.5
    cap_share: Share = 0.15
    cut_share: Share = 0.4
    length: Annotated[Range, Limits(0, is_open=True)] = (0.6, 1.1)
    volume: Annotated[Range, Limits(0, is_open=True)] = (0.75, 1.25)
    sway_mm: FromZero = 6.0
    density: Annotated[Range, Limits(0, is_open=True)] = (0.8, 1.15)
    thinning_share: Share = 0.4
    dyed_share: Share = 0.12
    vivid_share: Share = 0.03
    highlights_share: Share = 0.10
    grey_age_years: FromZero = 58.0
    brow_density: Annotated[Range, Limits(0, is_open=True)] = (0.75, 1.3)
    brow_thickness: Annotated[Range, Limits(0, is_open=True)] = (0.75, 1.25)
    brow_shift_mm: FromZero = 1.0
    no_brows_share: Share = 0.01
    joined_brows_share: Share = 0.04
    dyed_brows_share: Share = 0.08
    mascara_share: Share = 0.5

    def check(self) -> None:
        """Refuses numbers that nothing can be drawn from.

        Raises:
            UsageError: Names the first field that is wrong, what was expected of it and what was found.
        """
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
