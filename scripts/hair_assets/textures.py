"""Converts textures of hair to grey and alpha, without their colour, which each person draws."""

import io

import cv2
import numpy as np
from numpy import ndarray
from PIL import Image

from scripts.hair_assets.proxies import Proxy

# Mean grey of the opaque part of every texture, so that a colour looks alike on all of them.
MEAN_GREY = 0.5
# Largest contrast (standard deviation over mean) of a texture. Some have baked highlights.
MOST_CONTRAST = 0.42
WEBP_QUALITY = 90


def grey_and_alpha(proxy: Proxy, margin_px: int = 3) -> ndarray:
    """Returns the texture of a proxy as (h, w, 2) bytes: normalised grey, and alpha, 0 in parts that no quad uses."""
    alpha = proxy.texture[:, :, 3] * used_area(proxy, margin_px)
    grey = proxy.texture[:, :, :3].mean(axis=2)
    grey = _spread_beyond(grey, alpha)
    return as_bytes(normalised(grey, alpha), alpha)


def normalised(grey: ndarray, alpha: ndarray) -> ndarray:
    """Returns grey with a mean of `MEAN_GREY` over the opaque part, and a contrast of at most `MOST_CONTRAST`."""
    total = max(alpha.sum(), 1e-6)
    mean = (grey * alpha).sum() / total
    if mean < 1e-4:  # completely black
        return np.full_like(grey, MEAN_GREY)
    relative = grey / mean - 1
    deviation = np.sqrt((relative**2 * alpha).sum() / total)
    return MEAN_GREY * (1 + relative * min(1.0, MOST_CONTRAST / max(deviation, 1e-6)))


def used_area(proxy: Proxy, margin_px: int) -> ndarray:
    """Returns a mask of the parts of a texture that quads use, with a margin. It excludes watermarks elsewhere."""
    height, width = proxy.texture.shape[:2]
    used = np.zeros((height, width), np.uint8)
    for corners in proxy.uv[proxy.uv_quads] * [width, height]:
        cv2.fillConvexPoly(used, np.rint(corners).astype(np.int32), 1)
    size = 2 * margin_px + 1
    return cv2.dilate(used, np.ones((size, size), np.uint8))


def as_bytes(grey: ndarray, alpha: ndarray) -> ndarray:
    """Converts two channels from 0 to 1 to bytes."""
    return (np.clip(np.stack([grey, alpha], axis=2), 0, 1) * 255 + 0.5).astype(np.uint8)


def webp(picture: ndarray) -> bytes:
    """Encodes a picture with one (grey), two (grey, alpha) or three channels as WebP."""
    channels = 1 if picture.ndim == 2 else picture.shape[2]
    if channels == 2:
        picture = np.dstack([picture[:, :, :1]] * 3 + [picture[:, :, 1]])
    stream = io.BytesIO()
    Image.fromarray(picture).save(
        stream, "WEBP", quality=WEBP_QUALITY, alpha_quality=WEBP_QUALITY, method=6, exact=True
    )
    return stream.getvalue()


def baked(proxy: Proxy, places: ndarray, side: ndarray, shape: tuple[int, int]) -> ndarray:
    """Resamples the texture of a proxy to other texture coordinates. The proxy must not overlap itself.

    Args:
        proxy: The proxy.
        places: New texture coordinates of its points, (points, 2), 0 to 1.
        side: Mask of the points to use.
        shape: Rows and columns of the result.

    Returns:
        Colour and alpha, (rows, columns, 4); transparent outside the proxy.
    """
    rows, columns = shape
    source = np.zeros((rows, columns, 2), np.float32)
    covered = np.zeros((rows, columns), np.float32)
    for quad, uv_quad in zip(proxy.quads, proxy.uv_quads, strict=True):
        if side[quad].all():
            for corners in ([0, 1, 2], [0, 2, 3]):
                _fill(source, covered, places[quad[corners]] * [columns, rows], proxy.uv[uv_quad[corners]])
    size = np.array(proxy.texture.shape[1::-1])
    # Blurred before sampling, to avoid aliasing.
    shrink = max(1.0, float(np.median(np.abs(np.diff(source[covered > 0], axis=0)[:, 0])) * size[0]))
    texture = cv2.GaussianBlur(_premultiplied(proxy.texture), (0, 0), 0.4 * shrink)
    at = source * size.astype(np.float32) - 0.5
    out = cv2.remap(texture.astype(np.float32), at[..., 0], at[..., 1], cv2.INTER_LINEAR)
    out *= covered[..., None]
    out[..., :3] /= np.maximum(out[..., 3:], 1e-4)
    return out


def _fill(source: ndarray, covered: ndarray, corners: ndarray, values: ndarray) -> None:
    """Interpolates values over the pixels with centres in a triangle."""
    low = np.floor(corners.min(axis=0)).astype(int).clip(0)
    high = np.ceil(corners.max(axis=0)).astype(int) + 1
    high = np.minimum(high, covered.shape[::-1])
    if (high <= low).any():
        return
    x, y = np.meshgrid(np.arange(low[0], high[0]) + 0.5, np.arange(low[1], high[1]) + 0.5)
    system = np.linalg.pinv(np.vstack([corners.T, np.ones(3)]))
    shares = np.stack([x, y, np.ones_like(x)], axis=-1) @ system.T
    rows, columns = np.nonzero((shares > -1e-3).all(axis=-1))
    source[rows + low[1], columns + low[0]] = shares[rows, columns] @ values
    covered[rows + low[1], columns + low[0]] = 1


def _premultiplied(texture: ndarray) -> ndarray:
    return np.concatenate([texture[..., :3] * texture[..., 3:], texture[..., 3:]], axis=2)


def _spread_beyond(grey: ndarray, alpha: ndarray) -> ndarray:
    """Continues colours into transparent parts, so that mipmaps have no dark seams."""
    total, weight = np.zeros_like(grey), np.zeros_like(grey)
    for sigma in (1.5, 6.0, 24.0, 96.0):
        weight_here = cv2.GaussianBlur(alpha, (0, 0), sigma) + 1e-9
        grey_here = cv2.GaussianBlur(grey * alpha, (0, 0), sigma) / weight_here
        share = (1 - weight) * np.clip(weight_here * 50, 0, 1)
        total, weight = total + share * grey_here, weight + share
    beyond = total / np.maximum(weight, 1e-6)
    opaque = np.clip(alpha * 4, 0, 1)
    return opaque * grey + (1 - opaque) * beyond
