"""Distributions of skin, eyes and mouth."""

from dataclasses import dataclass
from typing import Annotated, final

from datagen.config_limits import Limits, Range, Share, check_limits


@final
@dataclass(frozen=True, kw_only=True)
class SkinConfig:
    """Shares of people and ranges, which are uniform unless said otherwise."""

    # Factor on the distance of a person's melanin from the middle; larger ones give more dark and light skins.
    melanin_contrast: Annotated[float, Limits(0, 4)] = 1.3
    # Standard deviation that is added to a person's place between the lightest and the darkest skin.
    melanin_spread: Annotated[float, Limits(0, 0.5)] = 0.05
    haemoglobin: Annotated[Range, Limits(0, 0.8)] = (0.07, 0.27)  # Blood in the skin: pale to ruddy; 0.16 is usual.
    flush: Annotated[Range, Limits(0, 0.8)] = (0.02, 0.22)  # Additional haemoglobin of cheeks, nose and ears.
    sunburn_share: Share = 0.04  # Share of people whose flush is two to four times as strong.
    blotches: Annotated[Range, Limits(0, 2)] = (0.04, 0.22)  # Relative unevenness of melanin and of blood.
    texture: Annotated[Range, Limits(0, 2)] = (0.55, 1.0)  # Strength of the texture of the skin.
    freckles_share: Share = 0.4  # Share of people with freckles among those without melanin; falls to 0 at medium skin.
    moles: Annotated[float, Limits(0, 12)] = 2.0  # Mean number of moles.
    acne_share: Share = 0.22  # Share of people under 30 with acne; a quarter of it above.
    scar_share: Share = 0.04  # Share of people with a scar on the face.
    vitiligo_share: Share = 0.006  # Share of people with white patches.
    tan_share: Share = 0.08  # Share of people whose skin is much darker where the sun reaches it.
    wrinkles: Annotated[float, Limits(0, 4)] = 1.0  # Factor on the wrinkles that come with age.
    expression_folds: Annotated[float, Limits(0, 4)] = 1.0  # Factor on the folds that expressions make.
    oil: Annotated[Range, Limits(0, 2)] = (0.05, 1.0)  # Shine of forehead, nose and cheeks.
    roughness: Annotated[Range, Limits(0.1, 1)] = (0.42, 0.62)  # Roughness of dry skin.
    make_up_share: Share = 0.5  # Share of women with make-up; a twelfth of it for men.
    vivid_make_up_share: Share = 0.12  # Share of make-up in colours that skin never has.
    face_paint_share: Share = 0.004  # Share of people with painted faces.
    shaved_shadow: Annotated[Range, Limits(0, 2)] = (0.0, 0.6)  # How dark the shaved beard area of a man is.
    stubble_share: Share = 0.35  # Share of men with short stubble.
    stubble: Annotated[Range, Limits(0, 2)] = (0.1, 0.75)  # Density of the stubble.
    pupil: Annotated[Range, Limits(0.1, 0.85)] = (0.2, 0.5)  # Radius of the pupil relative to that of the iris.
    odd_eyes_share: Share = 0.012  # Share of people with two different irises, or with coloured contact lenses.
    redness: Annotated[Range, Limits(0, 2)] = (0.0, 0.35)  # Redness of the white of the eye.
    yellow_teeth: Annotated[Range, Limits(0, 2)] = (0.0, 0.55)  # Colour of the teeth: 0 is bleached, 1 is brown.
    gap_share: Share = 0.12  # Share of people with gaps between their teeth.
    missing_tooth_share: Share = 0.015  # Share of people who lack one of the front teeth.
    gold_tooth_share: Share = 0.012  # Share of people with a gold tooth.
    braces_share: Share = 0.1  # Share of people under 22 with braces; a fifth of it above.

    def check(self) -> None:
        """Raises a `UsageError` that names the first field with a number that nothing can be drawn from."""
        check_limits("skin", self)


HARD_SKIN = SkinConfig(
    melanin_contrast=1.5,
    melanin_spread=0.09,
    haemoglobin=(0.04, 0.36),
    flush=(0.0, 0.34),
    sunburn_share=0.1,
    blotches=(0.04, 0.4),
    texture=(0.4, 1.0),
    freckles_share=0.5,
    moles=3.5,
    acne_share=0.4,
    scar_share=0.12,
    vitiligo_share=0.03,
    tan_share=0.15,
    wrinkles=1.3,
    expression_folds=1.3,
    oil=(0.0, 1.5),
    roughness=(0.36, 0.68),
    make_up_share=0.6,
    vivid_make_up_share=0.3,
    face_paint_share=0.05,
    shaved_shadow=(0.0, 0.85),
    stubble_share=0.45,
    stubble=(0.1, 0.95),
    pupil=(0.16, 0.65),
    odd_eyes_share=0.05,
    redness=(0.0, 0.7),
    yellow_teeth=(0.0, 1.0),
    gap_share=0.25,
    missing_tooth_share=0.06,
    gold_tooth_share=0.05,
    braces_share=0.2,
)
