"""What cameras, programs and files do to a scene."""

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray


def develop(rng: np.random.Generator, image: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "h w 3"]:
    """Other light and colours, blur, few pixels, noise, compression: each in some pictures."""
    image = _coloured(rng, image)
    if rng.uniform() < 0.25:
        image = _blurred(rng, image)
    if rng.uniform() < 0.2:
        factor = rng.uniform(0.3, 0.8)
        small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
        kind = int(rng.choice([cv2.INTER_LINEAR, cv2.INTER_CUBIC, cv2.INTER_NEAREST]))
        image = cv2.resize(small, (image.shape[1], image.shape[0]), interpolation=kind)
    if rng.uniform() < 0.35:
        noise = rng.standard_normal(image.shape, dtype=np.float32) * np.float32(rng.exponential(6))
        image = np.clip(image + noise, 0, 255).astype(np.uint8)
    if rng.uniform() < 0.4:
        quality = int(rng.integers(20, 95))
        content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        image = np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR))
    return np.ascontiguousarray(image)


def _coloured(rng: np.random.Generator, image: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "h w 3"]:
    gamma = np.exp(rng.normal(0, 0.3))
    gains = np.exp(rng.normal(0, 0.15) + rng.normal(0, 0.07, 3))
    steps = np.arange(256)[:, None] / 255
    low = rng.uniform(0, 0.15) if rng.uniform() < 0.2 else 0.0
    table = np.clip(255 * (low + (1 - low) * gains * steps**gamma), 0, 255).astype(np.uint8)
    image = cv2.LUT(image, table[None])
    kind = rng.uniform()
    if kind < 0.1:
        return np.repeat(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)[..., None], 3, axis=2)
    if kind < 0.3:
        grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)[..., None].astype(np.float32)
        image = np.clip(grey + rng.uniform(0.2, 1.6) * (image - grey), 0, 255).astype(np.uint8)
    return image


def _blurred(rng: np.random.Generator, image: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "h w 3"]:
    if rng.uniform() < 0.7:
        return cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.4, 2.2)))
    length = int(rng.integers(3, 10))
    kernel = np.zeros((length, length), dtype=np.float32)
    angle = rng.uniform(0, np.pi)
    reach = np.array([np.cos(angle), np.sin(angle)]) * (length - 1) / 2
    middle = np.array([(length - 1) / 2] * 2)
    cv2.line(kernel, (middle - reach).astype(int).tolist(), (middle + reach).astype(int).tolist(), 1.0)
    return cv2.filter2D(image, -1, kernel / max(float(kernel.sum()), 1))
