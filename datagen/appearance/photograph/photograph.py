"""What lens, sensor, processing and file make of the light in front of a camera.

The order is that of a camera: vignetting, blur and noise in linear light; white balance and tone; resampling,
sharpening and whatever else programs do; the border that a crop reaches beyond; the file.
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
    """Everything between the light and the file; `dataclasses.asdict` of it is JSON."""

    lens: Lens
    sensor: Sensor
    tone: Tone  # from light to bytes
    processing: Processing  # what programs did
    border: Border = field(default_factory=Border)  # where the photograph ends in the picture
    quality: int  # of the JPEG file, 1 to 100
    is_colour_halved: bool = True  # the file has colour at half the resolution
    faults: str = ""  # names out of `FAULTS`, joined by `+`; empty for a decent photograph
    seed: int  # of noise, grain and dust


def develop(
    linear: Float32[ndarray, "h w 3"], photograph: Photograph, face: Bool[ndarray, "h w"]
) -> UInt8[ndarray, "h w 3"]:
    """What a photograph shows of the light in front of it, which is not negative; 1 is white at exposure 1.

    The same light and photograph always give the same bytes. `face` says where the head is, for cameras that expose for
    it. The result is sRGB; pixels beyond the photograph's border (`beyond_border`) are filled.
    """
    rng = np.random.default_rng(photograph.seed)
    light = sense(photograph.sensor, expose_through(photograph.lens, linear), face, rng)
    image = process(photograph.processing, tone(photograph.tone, light), rng)
    return with_border(photograph.border, image)


def encode(image: UInt8[ndarray, "h w 3"], photograph: Photograph) -> bytes:
    """The file of a developed picture: JPEG of the photograph's quality."""
    return encode_photograph(image, photograph.quality, is_colour_halved=photograph.is_colour_halved)
