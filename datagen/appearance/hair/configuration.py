"""How often which hair, brows and lashes are drawn."""

from dataclasses import dataclass, fields
from typing import final

from pix2face.errors import UsageError


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

    no_mesh_share: float = 0.24
    over_face_share: float = 0.15
    covering_factor: float = 0.6
    mirrored_share: float = 0.5
    cap_share: float = 0.15
    cut_share: float = 0.4
    length: tuple[float, float] = (0.6, 1.1)
    volume: tuple[float, float] = (0.75, 1.25)
    sway_mm: float = 6.0
    density: tuple[float, float] = (0.8, 1.15)
    thinning_share: float = 0.4
    dyed_share: float = 0.12
    vivid_share: float = 0.03
    highlights_share: float = 0.10
    grey_age_years: float = 58.0
    brow_density: tuple[float, float] = (0.75, 1.3)
    brow_thickness: tuple[float, float] = (0.75, 1.25)
    brow_shift_mm: float = 1.0
    no_brows_share: float = 0.01
    joined_brows_share: float = 0.04
    dyed_brows_share: float = 0.08
    mascara_share: float = 0.5

    def check(self) -> None:
        """Refuses shares outside 0..1, ranges that run backward and factors below 0.

        Raises:
            UsageError: Naming the first such field.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, tuple):
                if not 0 < value[0] <= value[1]:
                    raise UsageError(f"hair.{field.name}: expected two rising numbers above 0, found {list(value)}")
            elif not 0 <= value <= (1 if field.name.endswith("_share") else float("inf")):
                wanted = "a share from 0 to 1" if field.name.endswith("_share") else "a number from 0"
                raise UsageError(f"hair.{field.name}: expected {wanted}, found {value}")


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
