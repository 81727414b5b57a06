"""Turns linear light into a photograph, by the effects of lens, sensor, processing and file.

Their order is that of a camera: vignetting, blur and noise in linear light; white balance and tone; resampling,
sharpening and other processing; the border, if the crop reaches beyond it; the file.
"""

from dataclasses import dataclass, field
from typing import final

import numpy as np
from jaxtyping import Bool, Float32, UInt8
from numpy import ndarray

from datagen.appearance.photograph.border import Border, with_border
from datagen.appearance.photograph.lens import Lens, expose_through
from datagen.appearance.photograph.processing import Processing, process
from datagen.appearance.photograph.sensor import Sensor, Tone, sense, tone
from pix2face.files.images import encode_photograph


@final
@dataclass(frozen=True, kw_only=True)
class Photograph:
    """All effects between the light and the file. `dataclasses.asdict` makes it JSON."""

    lens: Lens
    sensor: Sensor
    tone: Tone  # from light to bytes
    processing: Processing  # what programs did
    border: Border = field(default_factory=Border)  # border of the photograph in the picture
    quality: int  # quality of the JPEG file, 1 to 100
    is_colour_halved: bool = True  # whether the file has colour at half the resolution
    faults: str = ""  # names out of `FAULTS`, joined by `+`; empty for a decent photograph
    seed: int  # of noise, grain and dust


def develop(
    linear: Float32[ndarray, "h w 3"], photograph: Photograph, face: Bool[ndarray, "h w"]
) -> UInt8[ndarray, "h w 3"]:
    """Develops linear light into an sRGB picture, which depends on the arguments only.

    Args:
        linear: Non-negative linear light; 1 is white at exposure 1.
        photograph: The effects to apply. Pixels beyond its border (`beyond_border`) are filled.
        face: Mask of the head, for cameras that expose for it.
    """
    rng = np.random.default_rng(photograph.seed)
    light = sense(photograph.sensor, expose_through(photograph.lens, linear), face, rng)
    image = process(photograph.processing, tone(photograph.tone, light), rng)
    return with_border(photograph.border, image)


def encode(image: UInt8[ndarray, "h w 3"], photograph: Photograph) -> bytes:
    """Encodes a developed picture as JPEG, with the photograph's quality."""
    return encode_photograph(image, photograph.quality, is_colour_halved=photograph.is_colour_halved)
