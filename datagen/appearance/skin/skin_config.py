"""What skins, eyes and mouths are drawn from."""

from dataclasses import dataclass
from typing import Annotated, final

from datagen.config_limits import Limits, Range, Share, check_limits


@final
@dataclass(frozen=True, kw_only=True)
class SkinConfig:
    """Ranges and shares; ``share`` is how many people have it, ranges are uniform unless said otherwise.

    Attributes:
        melanin_contrast: Factor on the distance of the person's melanin from the middle: more dark and light skins.
        melanin_spread: Standard deviation that is added to the person's place between lightest and darkest skin.
        haemoglobin: From pale to ruddy; 0.16 is usual.
        flush: Further haemoglobin of cheeks, nose and ears.
        sunburn_share: People whose flush is two to four times that.
        blotches: Relative unevenness of melanin and of blood.
        texture: Strength of the skins' own texture.
        freckles_share: Share among people without melanin; falls to none at middling skin.
        moles: Mean number of moles.
        acne_share: Share among people under 30; a quarter of it above.
        scar_share: People with a scar on the face.
        vitiligo_share: People with white patches.
        tan_share: People whose sun-exposed skin is much darker.
        wrinkles: Factor on the wrinkles that come with age.
        expression_folds: Factor on the folds that expressions make.
        oil: Shine of forehead, nose and cheeks.
        roughness: Of dry skin.
        make_up_share: Women (men: a twelfth of it) with make-up.
        vivid_make_up_share: Of those, make-up in colours that skin never has.
        face_paint_share: People with painted faces.
        shaved_shadow: How dark the shaved beard area of a man is.
        stubble_share: Men with short stubble.
        stubble: How dense it is.
        pupil: Radius of the pupil over that of the iris.
        odd_eyes_share: People with two different irises, or irises in colours of contact lenses.
        redness: Of the sclera.
        yellow_teeth: 0 bleached, 1 brown.
        gap_share: People with gaps between the teeth.
        missing_tooth_share: People who miss one of the front teeth.
        gold_tooth_share: People with a gold tooth.
        braces_share: Share among people under 22; a fifth of it above.
    """

    melanin_contrast: Annotated[float, Limits(0, 4)] = 1.3
    melanin_spread: Annotated[float, Limits(0, 0.5)] = 0.05
    haemoglobin: Annotated[Range, Limits(0, 0.8)] = (0.07, 0.27)
    flush: Annotated[Range, Limits(0, 0.8)] = (0.02, 0.22)
    sunburn_share: Share = 0.04
    blotches: Annotated[Range, Limits(0, 2)] = (0.04, 0.22)
    texture: Annotated[Range, Limits(0, 2)] = (0.55, 1.0)
    freckles_share: Share = 0.4
    moles: Annotated[float, Limits(0, 12)] = 2.0
    acne_share: Share = 0.22
    scar_share: Share = 0.04
    vitiligo_share: Share = 0.006
    tan_share: Share = 0.08
    wrinkles: Annotated[float, Limits(0, 4)] = 1.0
    expression_folds: Annotated[float, Limits(0, 4)] = 1.0
    oil: Annotated[Range, Limits(0, 2)] = (0.05, 1.0)
    roughness: Annotated[Range, Limits(0.1, 1)] = (0.42, 0.62)
    make_up_share: Share = 0.5
    vivid_make_up_share: Share = 0.12
    face_paint_share: Share = 0.004
    shaved_shadow: Annotated[Range, Limits(0, 2)] = (0.0, 0.6)
    stubble_share: Share = 0.35
    stubble: Annotated[Range, Limits(0, 2)] = (0.1, 0.75)
    pupil: Annotated[Range, Limits(0.1, 0.85)] = (0.2, 0.5)
    odd_eyes_share: Share = 0.012
    redness: Annotated[Range, Limits(0, 2)] = (0.0, 0.35)
    yellow_teeth: Annotated[Range, Limits(0, 2)] = (0.0, 0.55)
    gap_share: Share = 0.12
    missing_tooth_share: Share = 0.015
    gold_tooth_share: Share = 0.012
    braces_share: Share = 0.1

    def check(self) -> None:
        """Refuses numbers that nothing can be drawn from.

        Raises:
            UsageError: Names the first field that is wrong, what was expected of it and what was found.
        """
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
