"""Generated backdrops, such as walls, clutter, text, tiles, foliage, shelves and lights, in sRGB bytes."""

from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

_FONTS = (cv2.FONT_HERSHEY_SIMPLEX, cv2.FONT_HERSHEY_DUPLEX, cv2.FONT_HERSHEY_COMPLEX, cv2.FONT_HERSHEY_SCRIPT_SIMPLEX)
_LETTERS = list("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789    &.,!?-")


def draw_pattern(name: str, seed: int, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws a pattern, which depends on name, seed and size only."""
    return PATTERNS[name](np.random.default_rng(seed), height, width)


def fractal(rng: np.random.Generator, height: int, width: int, cells: int, octaves: int) -> Float32[ndarray, "h w"]:
    """Draws smooth noise, 0..1 with a mean of about 0.5: octaves from `cells` cells on, each half as strong."""
    total = np.zeros((height, width), dtype=np.float32)
    for octave in range(octaves):
        n = min(cells * 2**octave, max(height, width))
        noise = rng.random((n, n), dtype=np.float32)
        total += cv2.resize(noise, (width, height), interpolation=cv2.INTER_LINEAR) * np.float32(0.5**octave)
    return total / np.float32(2 - 0.5 ** (octaves - 1))


def _paint(rng: np.random.Generator) -> tuple[float, float, float]:
    """Draws the colour of an object, with any hue and mostly low saturation."""
    value, saturation = rng.uniform(25, 245), rng.beta(1.2, 2.5)
    red, green, blue = value * (1 - saturation * rng.uniform(0, 1, size=3))
    return float(red), float(green), float(blue)


def _plane(rng: np.random.Generator, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws an unevenly lit surface of one colour."""
    corners = np.array(_paint(rng)) * rng.uniform(0.6, 1.1, size=(2, 2, 1))
    plane = cv2.resize(corners.astype(np.float32), (width, height), interpolation=cv2.INTER_LINEAR)
    return np.clip(plane, 0, 255).astype(np.uint8)


def _scaled(picture: UInt8[ndarray, "h w 3"], factor: Float32[ndarray, "h w"]) -> UInt8[ndarray, "h w 3"]:
    return np.clip(picture * factor[..., None], 0, 255).astype(np.uint8)


def _paper(rng: np.random.Generator, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws the paper of a studio with a spot of light."""
    rows, columns = np.mgrid[:height, :width].astype(np.float32) / np.float32(max(height, width))
    x, y = rng.uniform(0.1, 0.9, size=2)
    fall_off = np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * rng.uniform(0.25, 0.9) ** 2)).astype(np.float32)
    base = np.full((height, width, 3), _paint(rng), dtype=np.uint8)
    darkest = np.float32(rng.uniform(0.3, 0.9))
    return _scaled(base, darkest + (1 - darkest) * fall_off)


def _wall(rng: np.random.Generator, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws plaster, often with the shadow of a person."""
    grain = 1 + rng.uniform(0.02, 0.25) * (fractal(rng, height, width, int(rng.integers(3, 40)), 3) - 0.5)
    shadow = np.zeros((height, width), dtype=np.float32)
    if rng.uniform() < 0.7:
        x, y = int(rng.uniform(-0.1, 1.1) * width), int(rng.uniform(0.2, 0.8) * height)
        size = rng.uniform(0.25, 0.5) * height
        cv2.ellipse(shadow, (x, y), (int(0.75 * size), int(size)), rng.uniform(-15, 15), 0, 360, 1.0, -1)
        cv2.ellipse(shadow, (x, int(y + 2 * size)), (int(1.8 * size), int(1.2 * size)), 0, 0, 360, 1.0, -1)
        blur = max(0.5, rng.uniform(0.003, 0.03) * width)
        shadow = np.asarray(cv2.GaussianBlur(shadow, (0, 0), blur), dtype=np.float32)
    return _scaled(_plane(rng, height, width), grain * (1 - np.float32(rng.uniform(0.2, 0.7)) * shadow))


def _clutter(rng: np.random.Generator, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws objects of random shapes that overlap."""
    picture = _plane(rng, height, width)
    scale = np.array([width, height])
    for _ in range(int(rng.integers(8, 45))):
        centre = rng.uniform(-0.1, 1.1, size=2) * scale
        reach = rng.exponential(0.12) * max(height, width) + 2
        kind = rng.uniform()
        if kind < 0.4:
            corners = centre + reach * rng.normal(size=(int(rng.integers(3, 7)), 2))
            cv2.fillPoly(picture, [cv2.convexHull(corners.astype(np.int32))], _paint(rng), cv2.LINE_AA)
        elif kind < 0.7:
            axes = int(reach), int(reach * rng.uniform(0.3, 1))
            cv2.ellipse(picture, centre.astype(int).tolist(), axes, rng.uniform(0, 180), 0, 360, _paint(rng), -1)
        else:
            end = centre + rng.normal(size=2) * 3 * reach
            thick = int(rng.integers(1, max(2, width // 40)))
            cv2.line(picture, centre.astype(int).tolist(), end.astype(int).tolist(), _paint(rng), thick, cv2.LINE_AA)
    return picture


def _text(rng: np.random.Generator, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws posters and shop signs."""
    picture = _plane(rng, height, width)
    for _ in range(int(rng.integers(1, 4))):
        x, y = (rng.uniform(-0.2, 0.7, size=2) * [width, height]).astype(int).tolist()
        cv2.rectangle(picture, (x, y), (x + int(rng.uniform(0.2, 1) * width), y + height // 2), _paint(rng), -1)
    size = rng.uniform(0.2, 1.6) * width / 256
    baseline = rng.uniform(0, 0.2) * height
    while baseline < 1.05 * height:
        line = "".join(rng.choice(_LETTERS, size=int(rng.integers(4, 40))))
        place = int(rng.uniform(-0.3, 0.5) * width), int(baseline)
        font = int(rng.choice(_FONTS))
        cv2.putText(picture, line, place, font, size, _paint(rng), max(1, round(1.6 * size)), cv2.LINE_AA)
        baseline += max(4.0, rng.uniform(22, 60) * size)
    return picture


def _tiles(rng: np.random.Generator, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws bricks, tiles or parquet: rows of pieces with joints, seen at an angle."""
    n = int(rng.integers(3, 16))
    pieces = (np.array(_paint(rng)) * rng.uniform(0.75, 1.15, size=(2 * n, n, 1))).clip(0, 255)
    cell_width, cell_height, joint = 32, int(rng.choice([12, 16, 32])), 2
    wall = np.kron(pieces, np.ones((cell_height, cell_width, 1)))
    wall[np.arange(len(wall)) % cell_height < joint] = joints = np.array(_paint(rng))
    offset = cell_width // 2 if rng.uniform() < 0.6 else 0
    for row in range(2 * n):
        strip = wall[row * cell_height + joint : (row + 1) * cell_height]
        strip[:, (np.arange(wall.shape[1]) + offset * (row % 2)) % cell_width < joint] = joints
    rows, columns = wall.shape[:2]
    corners = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], dtype=np.float32)
    outward = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    target = np.array([[-0.1, -0.1], [1.1, -0.1], [1.1, 1.1], [-0.1, 1.1]]) + rng.uniform(-0.5, 0.05, (4, 2)) * outward
    transform = cv2.getPerspectiveTransform(corners, (target * [width, height]).astype(np.float32))
    flat = wall.astype(np.uint8)
    return np.asarray(cv2.warpPerspective(flat, transform, (width, height), flags=cv2.INTER_AREA), dtype=np.uint8)


def _foliage(rng: np.random.Generator, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws leaves in front of sky or shade, from noise at several scales."""
    cells = int(rng.integers(6, 20))
    light, gaps = fractal(rng, height, width, cells, 4), fractal(rng, height, width, max(3, cells // 3), 4)
    leaf = np.array([rng.uniform(40, 150), rng.uniform(80, 160), rng.uniform(15, 70)], dtype=np.float32)
    picture = leaf * (np.float32(0.2) + np.float32(2.2) * np.maximum(light - np.float32(0.25), 0))[..., None]
    sky = np.clip((gaps - np.float32(rng.uniform(0.5, 0.75))) * 12, 0, 1)[..., None]
    beyond = np.array(_paint(rng) if rng.uniform() < 0.5 else (225, 235, 245), dtype=np.float32)
    return np.clip(picture + sky * (beyond - picture), 0, 255).astype(np.uint8)


def _shelves(rng: np.random.Generator, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws books and boxes on shelves."""
    picture = _plane(rng, height, width)
    n_boards, board = int(rng.integers(2, 6)), _paint(rng)
    for shelf in range(n_boards):
        floor = round((shelf + rng.uniform(0.9, 1.0)) * height / n_boards)
        x = rng.uniform(-0.1, 0.1) * width
        while x < width:
            thick, tall = rng.uniform(0.015, 0.07) * width, rng.uniform(0.4, 0.85) * height / n_boards
            if rng.uniform() < 0.85:
                corner = round(x + thick) - 1, floor
                cv2.rectangle(picture, (round(x), round(floor - tall)), corner, _paint(rng), -1)
            x += thick
        cv2.rectangle(picture, (0, floor), (width, floor + max(1, height // 50)), board, -1)
    return picture


def _curtain(rng: np.random.Generator, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws folds of cloth."""
    columns = np.linspace(0, 1, width, dtype=np.float32)
    folds = np.zeros(width, dtype=np.float32)
    for _ in range(4):
        folds += np.sin(columns * np.float32(rng.uniform(8, 90)) + np.float32(rng.uniform(0, 6.3)))
    lean = np.float32(rng.normal(0, 0.15)) * np.linspace(0, 1, height, dtype=np.float32)[:, None]
    places = (np.broadcast_to(columns, (height, width)) + lean) * np.float32(width - 1)
    bent = np.interp(places.ravel(), np.arange(width), folds).reshape(height, width).astype(np.float32)
    return _scaled(_plane(rng, height, width), 0.75 + np.float32(rng.uniform(0.05, 0.15)) * bent)


def _lights(rng: np.random.Generator, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws lamps out of focus at night: discs that add up where they overlap."""
    picture = (_plane(rng, height, width) * rng.uniform(0.02, 0.3)).astype(np.uint8)
    radius = rng.uniform(0.008, 0.06) * width
    for _ in range(int(rng.integers(8, 50))):
        x, y = (rng.uniform(-0.05, 1.05, size=2) * [width, height]).astype(int).tolist()
        reach = max(1, round(radius * rng.uniform(0.7, 1.3)))
        top, left = max(y - reach, 0), max(x - reach, 0)
        part = picture[top : y + reach + 1, left : x + reach + 1]
        colour = (np.array(_paint(rng)) * rng.uniform(0.2, 1)).tolist()
        if part.size == 0:
            continue
        lamp = np.zeros(part.shape, dtype=np.uint8)
        cv2.circle(lamp, (x - left, y - top), reach, colour, -1, cv2.LINE_AA)
        part[...] = cv2.add(part, lamp)
    return picture


def _windows(rng: np.random.Generator, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws bright windows in a darker wall."""
    picture = (_plane(rng, height, width) * rng.uniform(0.2, 0.7)).astype(np.uint8)
    for _ in range(int(rng.integers(1, 4))):
        x, y = (rng.uniform(-0.2, 0.8, size=2) * [width, height]).astype(int).tolist()
        reach = (rng.uniform(0.15, 0.6, size=2) * [width, height]).astype(int)
        picture[max(y, 0) : y + reach[1], max(x, 0) : x + reach[0]] = rng.uniform(215, 255, size=3)
        bar = max(1, width // 60)
        for share in np.linspace(0, 1, int(rng.integers(2, 5))):
            across = x + round(share * reach[0])
            cv2.line(picture, (across, y), (across, y + int(reach[1])), (70, 60, 50), bar)
    return picture


def draw_background(rng: np.random.Generator, height: int, width: int) -> UInt8[ndarray, "h w 3"]:
    """Draws a blend of two gradients, noises, blocks or stripes in random colours, with a random blur."""
    pictures = [_ABSTRACT[int(rng.integers(len(_ABSTRACT)))](rng, height, width) for _ in range(2)]
    blend = rng.uniform(0, 0.5)
    picture: ndarray = (1 - blend) * pictures[0] + blend * pictures[1]
    blur = rng.exponential(0.01) * max(height, width)
    if blur > 0.3:
        picture = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), min(blur, 8.0))
    return np.clip(picture * 255, 0, 255).astype(np.uint8)


def _gradient(rng: np.random.Generator, height: int, width: int) -> Float32[ndarray, "h w 3"]:
    corners = rng.uniform(0, 1, size=(2, 2, 3)).astype(np.float32)
    return cv2.resize(corners, (width, height), interpolation=cv2.INTER_LINEAR)


def _smooth_noise(rng: np.random.Generator, height: int, width: int) -> Float32[ndarray, "h w 3"]:
    colours = rng.uniform(0, 1, size=(2, 3)).astype(np.float32)
    total = np.zeros((height, width), dtype=np.float32)
    for octave in range(4):
        cells = 3 * 2**octave
        noise = rng.uniform(0, 1, size=(cells, cells)).astype(np.float32)
        total += cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC) * np.float32(0.5**octave)
    total = (total / 1.875)[..., None]
    return np.asarray(colours[0] * (1 - total) + colours[1] * total, dtype=np.float32)


def _blocks(rng: np.random.Generator, height: int, width: int) -> Float32[ndarray, "h w 3"]:
    picture = np.full((height, width, 3), rng.uniform(0, 1, size=3), dtype=np.float32)
    for _ in range(int(rng.integers(4, 20))):
        x, y = rng.uniform(-0.2, 1, size=2) * [width, height]
        extent = rng.uniform(0.05, 0.7, size=2) * [width, height]
        corners = [(int(x), int(y)), (int(x + extent[0]), int(y + extent[1]))]
        cv2.rectangle(picture, corners[0], corners[1], rng.uniform(0, 1, size=3).tolist(), thickness=-1)
    return picture


def _stripes(rng: np.random.Generator, height: int, width: int) -> Float32[ndarray, "h w 3"]:
    angle, wavelength = rng.uniform(0, np.pi), rng.uniform(0.03, 0.3) * max(height, width)
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    phase = (np.cos(angle) * columns + np.sin(angle) * rows) * np.float32(2 * np.pi / wavelength)
    hardness = rng.uniform(1, 8)
    share = (0.5 + 0.5 * np.tanh(hardness * np.sin(phase)))[..., None]
    colours = rng.uniform(0, 1, size=(2, 3)).astype(np.float32)
    return np.asarray(colours[0] * (1 - share) + colours[1] * share, dtype=np.float32)


_ABSTRACT = (_gradient, _smooth_noise, _blocks, _stripes)


PATTERNS: dict[str, Callable[[np.random.Generator, int, int], UInt8[ndarray, "h w 3"]]] = {
    "paper": _paper,
    "wall": _wall,
    "clutter": _clutter,
    "text": _text,
    "tiles": _tiles,
    "foliage": _foliage,
    "shelves": _shelves,
    "curtain": _curtain,
    "lights": _lights,
    "windows": _windows,
    "abstract": draw_background,
}
