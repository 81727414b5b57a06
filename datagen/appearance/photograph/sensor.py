"""Exposure, white balance, noise and tone of a camera, which turn linear light into bytes."""

from dataclasses import dataclass
from functools import lru_cache
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8
from numpy import ndarray

from pix2face.files.images import linear_to_srgb

# Side of the field of noise: a prime, so that repetitions in larger windows are not aligned with other patterns.
_SIDE = 1009


def noise_window(rng: np.random.Generator, height: int, width: int) -> Float32[ndarray, "h w"]:
    """Returns standard normal noise: a read-only window at a random place of a fixed field.

    Drawing new noise would take longer than all other effects on a picture.
    """
    top, left = (int(place) for place in rng.integers(0, _SIDE, 2))
    field = _field()
    if top + height <= _SIDE and left + width <= _SIDE:
        return field[top : top + height, left : left + width]
    rows, columns = np.arange(top, top + height) % _SIDE, np.arange(left, left + width) % _SIDE
    return field[rows[:, None], columns]


@lru_cache(maxsize=1)
def _field() -> Float32[ndarray, "s s"]:
    field = np.random.default_rng(20).standard_normal((_SIDE, _SIDE), dtype=np.float32)
    field.flags.writeable = False
    return field


MIDDLE_GREY = 0.24  # mean linear light that the exposure aims at: skin in good light
LARGEST_GAIN = 24.0  # largest gain of the exposure, and inverse of the smallest
LARGEST_RATIO_OF_GREY = 2.5  # largest ratio of channels in pixels that may be grey in coloured light
LEAST_GREY = 0.03  # smallest share of such pixels for a white balance
LARGEST_EXCESS_OF_BLUE = 2.0  # largest ratio of blue to green that is corrected in skin; coloured lamps give more
_BRIGHTEST, _STEPS = 4.0, 4096  # largest value (1 is white) and number of entries of tone curves
_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)


@final
@dataclass(frozen=True, kw_only=True)
class Sensor:
    """Exposure and noise."""

    is_metered_on_face: bool = True  # whether the exposure depends on the face, if there is one, or the whole picture
    metering_strength: float = 1.0  # 0 does not change the light, 1 makes all pictures equally bright
    exposure_error_ev: float = 0.0  # error of the exposure in stops
    white_balance: float = 0.5  # 0 keeps the colour of the light, 1 makes the mean of pixels that may be grey grey
    gains: tuple[float, float, float] = (1.0, 1.0, 1.0)  # of red, green and blue: the error of the white balance
    noise: float = 0.0  # standard deviation at middle grey; 1 is white
    read_noise_share: float = 0.3  # share of read noise in the variance at middle grey
    colour_noise: float = 0.3  # strength of coarse noise that differs between channels, relative to the common noise


@final
@dataclass(frozen=True, kw_only=True)
class Tone:
    """The tone curve from linear light to bytes."""

    roll_off: float = 0.0  # 0 clips highlights at white, 1 compresses them as film does
    contrast: float = 1.0  # slope at the middle of the range, relative to the sRGB curve
    gamma: float = 1.0  # exponent after the sRGB curve; above 1 is darker
    black: float = 0.0  # value after the sRGB curve, 0..1, that becomes 0; shadows are crushed
    white: float = 1.0  # value after the sRGB curve that becomes 255; highlights are clipped
    lift: float = 0.0  # value that 0 becomes, 0..1, as in faded prints
    saturation: float = 1.0  # 0 is grey, 1 unchanged
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)  # gains of red, green and blue


def sense(
    sensor: Sensor, light: Float32[ndarray, "h w 3"], face: Bool[ndarray, "h w"], rng: np.random.Generator
) -> Float32[ndarray, "h w 3"]:
    """Exposes and balances linear light (white at 1), and adds noise."""
    # A sixteenth of the pixels is enough for metering and white balance.
    few, is_face = light[::4, ::4], face[::4, ::4]
    gains = _white_balance(sensor, few, is_face)
    metered = few[is_face] if sensor.is_metered_on_face and is_face.any() else few.reshape(-1, 3)
    gain = _metered_gain(sensor, metered * gains)
    factors = (*(gains * np.float32(gain)).tolist(), 0.0)
    exposed = cv2.multiply(light, factors)  # type: ignore[call-overload] # OpenCV's stubs know no scalars
    return _with_noise(sensor, exposed, rng) if sensor.noise else exposed


def tone(settings: Tone, light: Float32[ndarray, "h w 3"]) -> UInt8[ndarray, "h w 3"]:
    """Applies the tone curve, saturation and tint to linear light."""
    steps = np.clip(light, 0, _BRIGHTEST)
    cv2.sqrt(steps, dst=steps)
    steps *= np.float32((_STEPS - 1) / np.sqrt(_BRIGHTEST))
    image = tone_curve(settings).take(steps.astype(np.uint16))  # three times as fast as indexing
    if settings.saturation != 1 or settings.tint != (1.0, 1.0, 1.0):
        grey = np.tile(_LUMINANCE, (3, 1)) * (1 - settings.saturation)
        matrix = (grey + settings.saturation * np.eye(3)) * np.asarray(settings.tint)[:, None]
        image = cv2.transform(image, matrix)
    return image


def tone_curve(settings: Tone) -> UInt8[ndarray, " s"]:
    """Tabulates the curve to bytes at even steps of the square root of linear light, up to twice that of white."""
    light = np.linspace(0, 1, _STEPS) ** 2 * _BRIGHTEST
    # Reinhard et al. 2002, Eq. 4, scaled to keep middle grey; the largest value is white.
    bent = light * (1 + light / _BRIGHTEST**2) / (1 + light)
    bent *= MIDDLE_GREY / np.interp(MIDDLE_GREY, light, bent)
    light = np.clip((1 - settings.roll_off) * light + settings.roll_off * bent, 0, 1)
    value = linear_to_srgb(light) ** settings.gamma
    value = np.clip((value - settings.black) / (settings.white - settings.black), 0, 1)
    if settings.contrast != 1:
        # An S-shaped curve through 0, 1/2 and 1 with this slope in the middle.
        value = value**settings.contrast / (value**settings.contrast + (1 - value) ** settings.contrast)
    return np.asarray(np.rint(255 * (settings.lift + (1 - settings.lift) * value)), dtype=np.uint8)


def _white_balance(
    sensor: Sensor, light: Float32[ndarray, "h w 3"], is_face: Bool[ndarray, "h w"]
) -> Float32[ndarray, "3"]:
    # Treating skin, foliage or a green wall as grey would make faces blue or purple.
    is_grey = ~is_face & (light.max(axis=2) < LARGEST_RATIO_OF_GREY * light.min(axis=2))
    balance = np.ones(3)
    if np.count_nonzero(is_grey) >= LEAST_GREY * is_grey.size:
        mean = np.maximum(light[is_grey].mean(axis=0), 1e-6)
        # Limited, since no camera makes the light of a candle white.
        balance = np.clip((mean[1] / mean) ** sensor.white_balance, 0.5, 2.0)
    if is_face.any() and sensor.white_balance:
        # No white balance of a camera leaves more blue than green in skin.
        _, green, blue = balance * light[is_face].mean(axis=0)
        excess = np.sqrt(np.clip(blue / max(green, 1e-6), 1.0, LARGEST_EXCESS_OF_BLUE))
        balance *= (1.0, excess, 1 / excess)
    return np.asarray(balance * np.asarray(sensor.gains), dtype=np.float32)


def _metered_gain(sensor: Sensor, metered: Float32[ndarray, "n 3"]) -> float:
    luminance = np.clip(metered @ _LUMINANCE, 1e-4, 2 * _BRIGHTEST)
    # The geometric mean of arithmetic and geometric mean, which lamps and dark gaps affect less.
    brightness = float(np.sqrt(luminance.mean() * np.exp(np.log(luminance).mean())))
    gain = (MIDDLE_GREY / brightness) ** sensor.metering_strength
    return float(np.clip(gain, 1 / LARGEST_GAIN, LARGEST_GAIN) * 2.0**sensor.exposure_error_ev)


def _with_noise(
    sensor: Sensor, light: Float32[ndarray, "h w 3"], rng: np.random.Generator
) -> Float32[ndarray, "h w 3"]:
    height, width = light.shape[:2]
    luminance = cv2.transform(light, _LUMINANCE[None])
    # Shot noise is proportional to the square root of the light. Read noise is constant.
    shot = np.float32(sensor.noise**2 * (1 - sensor.read_noise_share) / MIDDLE_GREY)
    deviation = cv2.sqrt(luminance * shot + np.float32(sensor.noise**2 * sensor.read_noise_share))
    # With OpenCV and in place: NumPy is five times slower along an axis of length 3, and allocating memory takes as
    # long as the arithmetic.
    noise = cv2.merge([noise_window(rng, height, width)] * 3)
    if sensor.colour_noise:
        coarse = cv2.merge([noise_window(rng, (height + 1) // 2, (width + 1) // 2) for _ in range(3)])
        spots = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR)
        cv2.addWeighted(noise, 1, spots, 1.5 * sensor.colour_noise, 0, dst=noise)
    cv2.multiply(noise, cv2.merge([deviation] * 3), dst=noise)
    return cv2.add(light, noise, dst=noise)
