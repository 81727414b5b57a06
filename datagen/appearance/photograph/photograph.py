"""What lens, sensor, processing and file make of the light in front of a camera.

The order is that of a camera: in linear light vignetting, blur and noise; then white balance and tone; then resampling,
sharpening and what else programs do; then the border that a crop reaches beyond; then the file.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float32, UInt8
from numpy import ndarray

from datagen.appearance.photograph.border import Border, draw_border, draw_letterbox, with_border
from datagen.appearance.photograph.faults import draw_good_photograph, with_fault
from datagen.appearance.photograph.lens import Lens, expose_through
from datagen.appearance.photograph.photograph_config import FAULTS, PhotographConfig
from datagen.appearance.photograph.processing import Processing, encode_jpeg, process
from datagen.appearance.photograph.sensor import Sensor, Tone, sense, tone


@final
@dataclass(frozen=True, kw_only=True)
class Photograph:
    """All that happens between the light and the file, storable as JSON (``dataclasses.asdict``)."""

    lens: Lens
    sensor: Sensor
    tone: Tone  # from light to bytes
    processing: Processing  # what programs did
    border: Border  # where the photograph ends in the picture
    quality: int  # of the JPEG file, 1 to 100
    is_colour_halved: bool  # the file has colour at half the resolution
    faults: str  # names out of `FAULTS`, joined by `+`; empty for a decent photograph
    seed: int  # of noise, grain and dust


def draw_photograph(rng: np.random.Generator, config: PhotographConfig) -> Photograph:
    """Draws a photograph: most are decent, some are bad in one way or two, and some end within the picture."""
    seed = int(rng.integers(2**31))
    taken = draw_good_photograph(rng, config)
    faults: list[str] = []
    if rng.random() < config.bad_share:
        weights = np.array([getattr(config, f"bad_{name}") for name in FAULTS])
        most = min(2 if rng.random() < config.second_fault_share else 1, int((weights > 0).sum()))
        faults = [str(name) for name in rng.choice(FAULTS, most, replace=False, p=weights / weights.sum())]
    for name in faults:
        taken = with_fault(name, taken, rng, config)
    kind = rng.random()
    border = Border()
    if kind < config.border_share:
        border = draw_border(rng, config.largest_border)
    elif kind < config.border_share + config.letterbox_share:
        border = draw_letterbox(rng)
    return Photograph(
        lens=taken.lens,
        sensor=taken.sensor,
        tone=taken.tone,
        processing=taken.processing,
        border=border,
        quality=taken.quality,
        is_colour_halved=bool(rng.random() < 0.8),
        faults="+".join(sorted(faults)),
        seed=seed,
    )


def develop(
    linear: Float32[ndarray, "h w 3"], photograph: Photograph, face: Bool[ndarray, "h w"]
) -> UInt8[ndarray, "h w 3"]:
    """What a photograph shows of the light in front of it.

    Args:
        linear: Light, 1 is white at exposure 1; not negative.
        photograph: What happens to it; the same light and photograph always give the same bytes.
        face: Where the head is, for cameras that expose for it.

    Returns:
        sRGB, with what is beyond the photograph's border filled; ``beyond_border(photograph.border, h, w)`` says where.
    """
    rng = np.random.default_rng(photograph.seed)
    light = sense(photograph.sensor, expose_through(photograph.lens, linear), face, rng)
    image = process(photograph.processing, tone(photograph.tone, light), rng)
    return with_border(photograph.border, image)


def encode(image: UInt8[ndarray, "h w 3"], photograph: Photograph) -> bytes:
    """The file of a developed picture: JPEG of the photograph's quality."""
    return encode_jpeg(image, photograph.quality, is_colour_halved=photograph.is_colour_halved)
