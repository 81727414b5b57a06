"""Draws tileable noise for spots, stubble and pores, for which 512-pixel skins are too coarse."""

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from datagen.appearance.skin.skin_textures import NOISE_PX

# Numbers of freckles, hairs and pores in a tile. The shader shows the first layer 96 mm wide, the second 20 mm.
N_FRECKLES, N_HAIRS, N_PORES = 1100, 5200, 420


def draw_noise(rng: np.random.Generator) -> UInt8[ndarray, "2 h w 4"]:
    """Draws two layers.

    Channels of layer 0 are blotches some tenths of the tile wide, freckles of different strengths, finer blotches, and
    stubble. Those of layer 1 are the gradient of pores and fine creases along u and v, their height, and variation of
    the colour.
    """
    wide, fine = _fractal(rng, 3.0), _fractal(rng, 14.0)
    freckles = _dots(rng, N_FRECKLES, (1.1, 2.6)) + _dots(rng, N_FRECKLES // 6, (2.5, 4.2))
    hairs = np.clip(_dots(rng, N_HAIRS, (0.55, 0.8)) * 2.2, 0, 1)
    height = 0.6 * _fractal(rng, 30.0) - 1.6 * np.clip(_dots(rng, N_PORES, (1.6, 3.2)), 0, 1)
    along_u = np.roll(height, -1, axis=1) - np.roll(height, 1, axis=1)
    along_v = np.roll(height, -1, axis=0) - np.roll(height, 1, axis=0)
    first = [_bytes(wide, 0.17), np.clip(freckles, 0, 1), _bytes(fine, 0.17), hairs]
    second = [_bytes(along_u, 0.3), _bytes(along_v, 0.3), _bytes(height, 0.2), _bytes(_fractal(rng, 24.0), 0.17)]
    return np.stack([np.stack(layer, axis=-1) * 255 + 0.5 for layer in (first, second)]).astype(np.uint8)


def _bytes(values: Float64[ndarray, "h w"], scale: float) -> Float64[ndarray, "h w"]:
    """Scales values to a mean of 0.5 and a standard deviation of ``scale``, clipped to 0..1."""
    return np.asarray(np.clip(0.5 + scale * (values - values.mean()) / values.std(), 0, 1))


def _fractal(rng: np.random.Generator, waves: float) -> Float64[ndarray, "h w"]:
    """Draws periodic noise with its largest power at ``waves`` waves per tile."""
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(NOISE_PX, 1 / NOISE_PX), np.fft.fftfreq(NOISE_PX, 1 / NOISE_PX)))
    ratio = np.maximum(frequency, 1e-6) / waves
    spectrum = np.fft.fft2(rng.normal(size=(NOISE_PX, NOISE_PX))) * np.where(ratio < 1, ratio**2, ratio**-1.5)
    noise = np.fft.ifft2(spectrum).real
    return np.asarray(noise / noise.std())


def _dots(rng: np.random.Generator, count: int, radius_px: tuple[float, float]) -> Float64[ndarray, "h w"]:
    """Draws soft dots of random strengths, periodic across the borders of the tile."""
    out = np.zeros((NOISE_PX, NOISE_PX))
    reach = int(3 * radius_px[1]) + 1
    offsets = np.arange(-reach, reach + 1)
    for _ in range(count):
        place, radius, strength = rng.uniform(0, NOISE_PX, 2), rng.uniform(*radius_px), rng.uniform(0.15, 1)
        rows, columns = (np.floor(place[axis]).astype(int) + offsets for axis in range(2))
        squared = (rows[:, None] + 0.5 - place[0]) ** 2 + (columns[None] + 0.5 - place[1]) ** 2
        window = np.ix_(rows % NOISE_PX, columns % NOISE_PX)
        out[window] = np.maximum(out[window], strength * np.exp(-squared / radius**2))
    return out
