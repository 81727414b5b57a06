"""Distributions of the effects of lens, sensor, processing and file."""

from dataclasses import dataclass
from typing import Annotated, final

from datagen.config_limits import FromZero, Limits, Range, Share, check_limits, check_parts, check_weights


@final
@dataclass(frozen=True, kw_only=True)
class PhotographConfig:
    """Shares and ranges of the effects on a photograph.

    Lengths are shares of the picture's side, so that effects do not depend on the number of pixels.
    """

    bad_share: Share = 0.2  # Share of pictures that are bad in some way; the `bad_` weights below say in which.
    second_fault_share: Share = 0.2  # Share of bad pictures with two faults.
    bad_exposure: FromZero = 1.0  # Weight of pictures that are far too dark or too bright, crushed or burnt out.
    # Weight of pictures with a wrong white balance, or with colours that are much too strong or too weak.
    bad_colour: FromZero = 0.8
    bad_focus: FromZero = 1.0  # Weight of pictures out of focus.
    bad_motion: FromZero = 1.0  # Weight of pictures with motion blur.
    bad_noise: FromZero = 1.0  # Weight of pictures with strong noise.
    bad_resolution: FromZero = 1.8  # Weight of small pictures that were enlarged.
    bad_file: FromZero = 1.0  # Weight of low JPEG quality and oversharpening.
    bad_film: FromZero = 0.7  # Weight of old photographs: fading, scratches, dust, grain.
    bad_screen: FromZero = 0.25  # Weight of photographs of a screen.
    bad_interlace: FromZero = 0.25  # Weight of television frames whose lines come from two moments.
    bad_posterised: FromZero = 0.2  # Weight of pictures with few colours.
    bad_glare: FromZero = 0.6  # Weight of pictures with glare, from light that falls into the lens.
    # Share of cameras that expose for the face; the others expose for the whole picture.
    face_metering_share: Share = 0.6
    # Smallest and largest strength of the metering: 0 leaves the light as it is, 1 makes all pictures equally bright.
    metering_strength: Annotated[Range, Limits(0, 1)] = (0.65, 1.0)
    exposure_error_ev: FromZero = 0.45  # Standard deviation of the exposure, in stops.
    # Largest error of badly exposed pictures, in stops.
    largest_exposure_error_ev: Annotated[float, Limits(0, 4)] = 1.6
    # Smallest and largest strength of the white balance: 0 leaves the colour of the light, 1 takes all of it for grey.
    white_balance: Annotated[Range, Limits(0, 1)] = (0.2, 0.8)
    white_balance_error: FromZero = 0.04  # Standard deviation of the logarithm of the gains of the colour channels.
    # Median logarithm of the gain of red, and of the loss of blue: cameras and people keep skin warm.
    warmth: Annotated[float, Limits(0, 0.5)] = 0.05
    film_curve_share: Share = 0.6  # Share of pictures whose highlights roll off; in the others they are clipped.
    median_contrast: Annotated[float, Limits(0.2, 5)] = 1.3  # Median slope at middle grey, relative to the sRGB curve.
    contrast: FromZero = 0.18  # Standard deviation of the logarithm of the contrast.
    gamma: FromZero = 0.08  # Standard deviation of the logarithm of the exponent after the sRGB curve.
    saturation: FromZero = 0.15  # Standard deviation of the logarithm of the saturation.
    vignetting_share: Share = 0.25  # Share of pictures with dark corners.
    # Mean blur radius of decent pictures, which is at most three times as large; 0.004 is one pixel of 256.
    defocus: FromZero = 0.0015
    # Smallest and largest blur radius of pictures out of focus.
    bad_defocus: Annotated[Range, Limits(0, 0.1)] = (0.006, 0.020)
    # Smallest and largest length of the path of motion blur.
    bad_motion_length: Annotated[Range, Limits(0, 0.3)] = (0.02, 0.07)
    chromatic_aberration_share: Share = 0.10  # Share of lenses that magnify colours differently.
    bloom_share: Share = 0.12  # Share of lenses in which highlights glow.
    # Mean standard deviation of the noise of decent pictures at middle grey, in linear light where 1 is white.
    noise: FromZero = 0.006
    # Smallest and largest standard deviation of the noise of bad pictures.
    bad_noise_deviation: Annotated[Range, Limits(0)] = (0.025, 0.09)
    # Smallest and largest side of pictures before they are enlarged; a face takes about 0.63 of it.
    resolution_px: Annotated[Range, Limits(8, 16384)] = (38.0, 120.0)
    monochrome_share: Share = 0.06  # Share of pictures in black and white.
    toned_share: Share = 0.25  # Share of monochrome pictures that are sepia or toned otherwise.
    smoothed_share: Share = 0.04  # Share of pictures in which a program smoothed the skin.
    sharpened_share: Share = 0.25  # Share of pictures that are sharpened, with haloes.
    overlay_share: Share = 0.03  # Share of pictures with a watermark, a text or a date.
    jpeg_quality: Annotated[Range, Limits(1, 100)] = (65.0, 98.0)  # Smallest and largest quality of most files.
    bad_jpeg_quality: Annotated[Range, Limits(1, 100)] = (30.0, 50.0)  # Smallest and largest quality of bad files.
    twice_jpeg_share: Share = 0.25  # Share of pictures that were compressed before.
    border_share: Share = 0.25  # Share of crops that reach beyond the border of the photograph.
    largest_border: Annotated[float, Limits(0, 0.45)] = 0.4  # Largest share of the picture beyond one border.
    letterbox_share: Share = 0.02  # Share of pictures in a frame: bars on two opposite sides.

    def check(self) -> None:
        """Raises a `UsageError` that names the first field with a number that nothing can be drawn from."""
        check_limits("photograph", self)
        check_parts("photograph", self, "border_share", "letterbox_share")
        if self.bad_share:
            check_weights("photograph", self, *(f"bad_{name}" for name in FAULTS))


# Faults of bad pictures, with the weights `bad_NAME`.
FAULTS = (
    "exposure",
    "colour",
    "focus",
    "motion",
    "noise",
    "resolution",
    "file",
    "film",
    "screen",
    "interlace",
    "posterised",
    "glare",
)

# Rare effects are more frequent, and ranges are wider.
HARD_PHOTOGRAPH = PhotographConfig(
    bad_share=0.65,
    second_fault_share=0.4,
    exposure_error_ev=0.6,
    largest_exposure_error_ev=2.2,
    white_balance=(0.0, 0.9),
    white_balance_error=0.1,
    contrast=0.28,
    gamma=0.15,
    saturation=0.3,
    vignetting_share=0.4,
    defocus=0.003,
    bad_defocus=(0.01, 0.035),
    bad_motion_length=(0.03, 0.12),
    chromatic_aberration_share=0.2,
    bloom_share=0.2,
    noise=0.012,
    bad_noise_deviation=(0.04, 0.14),
    resolution_px=(32.0, 90.0),
    monochrome_share=0.15,
    smoothed_share=0.06,
    overlay_share=0.08,
    jpeg_quality=(45.0, 95.0),
    bad_jpeg_quality=(15.0, 40.0),
    twice_jpeg_share=0.5,
    border_share=0.4,
    letterbox_share=0.06,
)
