"""Draws wrinkles and brows of the mean face to a texture."""

from itertools import pairwise

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from datagen.appearance.skin.skin_textures import DETAILS_PX, DETAILS_UV, LARGEST_GRADIENT
from pix2face.models.morphable_model import MorphableModel
from scripts.skin_assets.places import places

# Lines on the mean face from the front: width in mm, depth, and points (x, y) in mm on the subject's left side
# (mirrored for the right). The place of a line determines which expressions deepen it: see `wrinkles` in skin.glsl.
FOREHEAD = [
    (1.3, 0.8, [(0, 62), (14, 64), (28, 67), (44, 66)]),
    (1.4, 1.0, [(0, 69), (12, 70), (30, 73), (48, 71)]),
    (1.4, 1.0, [(0, 77), (15, 78), (32, 80), (50, 77)]),
    (1.3, 0.8, [(0, 85), (16, 86), (34, 87), (46, 85)]),
    (1.2, 0.5, [(4, 92), (20, 93), (36, 92)]),
]
GLABELLA = [
    (1.4, 1.0, [(6, 40), (6.5, 47), (8.5, 56)]),
    (1.0, 0.4, [(2, 41), (1.5, 50)]),
    (1.1, 0.6, [(0, 31), (4, 31.5), (9, 34)]),
]
EYE = [
    (1.0, 0.9, [(48, 28), (55, 31), (64, 36)]),
    (1.0, 1.0, [(49, 26), (57, 26), (66, 26.5)]),
    (1.0, 0.8, [(48, 23), (56, 20), (63, 16)]),
    (0.9, 0.5, [(49, 30.5), (56, 36), (61, 42)]),
    (1.5, 0.8, [(15, 19), (21, 13.5), (31, 11.5), (42, 14)]),
    (0.9, 0.5, [(19, 19), (28, 16), (40, 17.5)]),
    (0.9, 0.4, [(24, 36.5), (34, 37.5), (44, 33)]),
]
SMILE = [
    (1.9, 1.0, [(15.5, -13), (21, -21), (26.5, -30), (30, -39), (31, -47)]),
    (1.4, 0.6, [(27, -46), (29.5, -53), (29, -63)]),
    (1.3, 0.35, [(36, -24), (41, -34), (42, -46)]),
    (1.2, 0.25, [(46, -22), (51, -34), (51, -46)]),
    (2.0, 0.6, [(0, -60), (9, -60.5), (16, -58)]),
]
LIPS = [
    (0.8, 0.6, [(x, -31 - 0.06 * x * x / 4), (1.12 * x, -24 - 0.02 * x * x)]) for x in (2.5, 5.5, 8.5, 11.5, 14.5)
] + [(0.8, 0.5, [(x, -53), (1.1 * x, -58)]) for x in (4.0, 8.0, 12.0)]
BROW = [(14.5, 45.0), (22.0, 48.5), (34.0, 51.0), (46.0, 51.5), (56.0, 47.5), (60.5, 44.0)]
BROW_HALF_WIDTH_MM = (3.4, 3.6, 3.4, 2.7, 1.6, 0.6)
N_HAIRS = 420


def draw_details(rng: np.random.Generator, model: MorphableModel) -> UInt8[ndarray, "1 h w 4"]:
    """Draws wrinkles (gradient of the depth along x and y, depth) and the strands of brows."""
    place = places(model, ("skin", "brows", "lips"), DETAILS_UV, DETAILS_PX)
    x, y = place[..., 0], place[..., 1]
    front = np.clip(place[..., 2] / 20, 0, 1)
    bend = rng.normal(size=(2, 6)) * [[0.25], [0.25]]
    lines = [line for group in (FOREHEAD, GLABELLA, EYE, SMILE, LIPS) for line in group]
    step = 0.15
    depth, right, up = (
        front * _depth(lines, *_bent(x + step * dx, y + step * dy, bend)) for dx, dy in ((0, 0), (1, 0), (0, 1))
    )
    gradient = [0.5 + 0.5 * np.clip((other - depth) / step / LARGEST_GRADIENT, -1, 1) for other in (right, up)]
    channels = np.stack([*gradient, np.clip(depth, 0, 1), _brows(rng, x, y)], axis=-1)
    return np.asarray(channels[None] * 255 + 0.5, dtype=np.uint8)


def _bent(x: ndarray, y: ndarray, bend: Float64[ndarray, "2 6"]) -> tuple[ndarray, ndarray]:
    """Displaces places by waves, since faces are not symmetric and lines are not smooth."""
    waves = [np.sin(x / (11 - k) + 0.21 * k * y / (5 + k) + 2.4 * k) for k in range(6)]
    return x + sum(b * w for b, w in zip(bend[0], waves, strict=True)), y + 2 * sum(
        b * w for b, w in zip(bend[1], waves, strict=True)
    )


def _depth(lines: list[tuple[float, float, list[tuple[float, float]]]], x: ndarray, y: ndarray) -> ndarray:
    depth = np.zeros_like(x)
    for width, strength, points in lines:
        distance, along = _distance(np.array(points, dtype=np.float64), np.abs(x), y)
        fade = np.clip(6 * np.minimum(along + (points[0][0] == 0), 1 - along), 0, 1)
        depth = np.maximum(depth, strength * fade * np.exp(-((distance / width) ** 2)))
    return depth


def _distance(points: Float64[ndarray, "n 2"], x: ndarray, y: ndarray) -> tuple[ndarray, ndarray]:
    """Returns the distance from a polyline, and the position (0..1) of the nearest point along it."""
    best, along = np.full_like(x, np.inf), np.zeros_like(x)
    for k, (a, b) in enumerate(pairwise(points)):
        t = np.clip(((x - a[0]) * (b[0] - a[0]) + (y - a[1]) * (b[1] - a[1])) / ((b - a) ** 2).sum(), 0, 1)
        distance = np.hypot(x - a[0] - t * (b[0] - a[0]), y - a[1] - t * (b[1] - a[1]))
        along = np.where(distance < best, (k + t) / (len(points) - 1), along)
        best = np.minimum(best, distance)
    return best, along


def _brows(rng: np.random.Generator, x: ndarray, y: ndarray) -> Float64[ndarray, "h w"]:
    """Draws short strands along both brows, steeper and sparser at the inner end."""
    arc = np.array(BROW)
    knots = np.linspace(0, 1, len(arc))
    out = np.zeros_like(x)
    for side in (-1.0, 1.0):
        for _ in range(N_HAIRS):
            t = rng.beta(1.15, 1.25)
            across = rng.normal(0, 0.5)
            middle = np.array([np.interp(t, knots, arc[:, axis]) for axis in range(2)])
            middle[1] += across * float(np.interp(t, knots, BROW_HALF_WIDTH_MM))
            turn = np.deg2rad(np.interp(t, [0, 0.2, 1], [70, 25, -25]) - 18 * across + rng.normal(0, 8))
            length = rng.uniform(3, 6.5) * np.interp(t, [0, 0.8, 1], [0.9, 1, 0.6])
            end = middle + length * np.array([np.cos(turn), np.sin(turn)])
            near = (np.abs(side * x - middle[0]) < 10) & (np.abs(y - middle[1]) < 10)
            distance, along = _distance(np.array([middle, end]), side * x[near], y[near])
            strand = rng.uniform(0.5, 0.9) * np.exp(-((distance / (0.5 * (1.15 - along))) ** 2))
            out[near] = 1 - (1 - out[near]) * (1 - strand)
    return np.clip(out, 0, 1)
