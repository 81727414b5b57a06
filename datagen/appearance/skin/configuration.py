"""What skins, eyes and mouths are drawn from."""

from dataclasses import dataclass, fields
from typing import final

from pix2face.errors import UsageError

Range = tuple[float, float]


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

    melanin_contrast: float = 1.3
    melanin_spread: float = 0.05
    haemoglobin: Range = (0.07, 0.27)
    flush: Range = (0.02, 0.22)
    sunburn_share: float = 0.04
    blotches: Range = (0.04, 0.22)
    texture: Range = (0.55, 1.0)
    freckles_share: float = 0.4
    moles: float = 2.0
    acne_share: float = 0.22
    scar_share: float = 0.04
    vitiligo_share: float = 0.006
    tan_share: float = 0.08
    wrinkles: float = 1.0
    expression_folds: float = 1.0
    oil: Range = (0.05, 1.0)
    roughness: Range = (0.42, 0.62)
    make_up_share: float = 0.5
    vivid_make_up_share: float = 0.12
    face_paint_share: float = 0.004
    shaved_shadow: Range = (0.0, 0.6)
    stubble_share: float = 0.35
    stubble: Range = (0.1, 0.75)
    pupil: Range = (0.2, 0.5)
    odd_eyes_share: float = 0.012
    redness: Range = (0.0, 0.35)
    yellow_teeth: Range = (0.0, 0.55)
    gap_share: float = 0.12
    missing_tooth_share: float = 0.015
    gold_tooth_share: float = 0.012
    braces_share: float = 0.1

    def check(self) -> None:
        """Raises UsageError where a share is none, or a range is empty or outside what the shader takes."""
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, tuple):
                _check_range(field.name, value)
            elif field.name.endswith("_share"):
                if not 0 <= value <= 1:
                    raise UsageError(f"skin.{field.name}: expected a share from 0 to 1, found {value}")
            elif not 0 <= value < _MOST.get(field.name, 4.0):
                raise UsageError(f"skin.{field.name}: expected 0 to {_MOST.get(field.name, 4.0)}, found {value}")


# Beyond these numbers and ranges it is no longer a human head.
_MOST = {"melanin_spread": 0.5, "moles": 12.0}
_LIMITS = {"haemoglobin": (0.0, 0.8), "flush": (0.0, 0.8), "roughness": (0.1, 1.0), "pupil": (0.1, 0.85)}

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


def _check_range(name: str, value: Range) -> None:
    low, high = _LIMITS.get(name, (0.0, 2.0))
    if not low <= value[0] <= value[1] <= high:
        raise UsageError(f"skin.{name}: expected two numbers from {low} to {high}, the smaller first, found {value}")
