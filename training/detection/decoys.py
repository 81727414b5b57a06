"""What is no face: things with the outline of a person, heads without a face, parts of heads, and drawn things."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Final, final

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.files.images import read_bytes, read_cutout
from training.detection.people import Person

PART_TRIES: Final = 8  # at parts of a head that show little of the face
MOST_FACE_OF_A_PART = 0.3  # of its area
THING_SIDE_PX: Final = 160  # things are kept no larger


@final
class Things:
    """Drawn animals, plants, tools and the like on a transparent ground.

    Args:
        folders: Of PNG files, searched with their subfolders. They are taken to show no human face.

    Raises:
        UsageError: A folder holds no PNG file.
    """

    def __init__(self, folders: Sequence[Path]) -> None:
        self._paths: list[Path] = []
        for folder in folders:
            paths = sorted(folder.rglob("*.png"))
            if not paths:
                raise UsageError(f"{folder}: expected PNG files of things, found none")
            self._paths += paths
        self._read = lru_cache(len(self._paths) or 1)(_read_thing)

    def __len__(self) -> int:
        return len(self._paths)

    def contents(self) -> list[bytes]:
        """The content of each file."""
        return [read_bytes(path) for path in self._paths]

    def draw(self, rng: np.random.Generator) -> UInt8[ndarray, "h w 4"]:
        """One of the things."""
        return self._read(self._paths[int(rng.integers(len(self._paths)))])


def _read_thing(path: Path) -> UInt8[ndarray, "h w 4"]:
    picture = read_cutout(path)
    shown = np.argwhere(picture[..., 3] > 0)
    if len(shown):
        (top, left), (bottom, right) = shown.min(axis=0), shown.max(axis=0) + 1
        picture = picture[top:bottom, left:right]
    scale = min(THING_SIDE_PX / max(picture.shape[:2]), 1.0)
    size = (max(round(picture.shape[1] * scale), 1), max(round(picture.shape[0] * scale), 1))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def textured(
    rng: np.random.Generator, rgba: UInt8[ndarray, "h w 4"], texture: UInt8[ndarray, "h w 3"]
) -> UInt8[ndarray, "h w 4"]:
    """A thing whose colours vary as a texture does, and whose hue is turned."""
    colour = rgba[..., :3].astype(np.float32)
    if rng.uniform() < 0.5:
        hsv = cv2.cvtColor(rgba[..., :3], cv2.COLOR_RGB2HSV)
        hsv[..., 0] = (hsv[..., 0].astype(np.int32) + int(rng.integers(180))) % 180
        colour = cv2.cvtColor(hsv, cv2.COLOR_HSV2RGB).astype(np.float32)
    grey = cv2.cvtColor(texture, cv2.COLOR_RGB2GRAY).astype(np.float32)
    factor = 1 + np.float32(rng.uniform(0, 1)) * (grey / max(float(grey.mean()), 1.0) - 1)
    return np.dstack([np.clip(colour * factor[..., None], 0, 255).astype(np.uint8), rgba[..., 3]])


def without_face(rng: np.random.Generator, rgba: UInt8[ndarray, "h w 4"], person: Person) -> UInt8[ndarray, "h w 4"]:
    """A head from which the face is gone: its hull has the colour of something else of the person, with some grain."""
    centre = person.landmarks2d.mean(axis=0)
    hull = cv2.convexHull((centre + 1.15 * (person.landmarks2d - centre)).astype(np.int32))
    mask = np.zeros(rgba.shape[:2], dtype=np.uint8)
    cv2.fillConvexPoly(mask, hull, 255)
    soft = (cv2.GaussianBlur(mask, (0, 0), 3) / np.float32(255))[..., None]
    solid = np.argwhere(rgba[..., 3] > 200)
    row, column = solid[int(rng.integers(len(solid)))] if len(solid) else (0, 0)
    noise = rng.normal(0, rng.uniform(0, 12), (len(rgba) // 4 + 1, rgba.shape[1] // 4 + 1)).astype(np.float32)
    grain = np.asarray(cv2.resize(noise, (rgba.shape[1], rgba.shape[0]), interpolation=cv2.INTER_LINEAR))
    paint = np.clip(rgba[row, column, :3].astype(np.float32) + grain[..., None], 0, 255)
    colour = rgba[..., :3] + soft * (paint - rgba[..., :3])
    return np.dstack([colour.astype(np.uint8), rgba[..., 3]])


def part_of_head(rng: np.random.Generator, person: Person) -> UInt8[ndarray, "s s 4"] | None:
    """An ear, hair, a neck or a shoulder: a part of the render that shows little of the face; None if none is found."""
    low, high = person.landmarks2d.min(axis=0), person.landmarks2d.max(axis=0)
    solid = np.argwhere(person.rgba[..., 3] > 200)
    if not len(solid):
        return None
    for _ in range(PART_TRIES):
        side = max(int((high - low).max() * rng.uniform(0.25, 0.7)), 8)
        row, column = solid[int(rng.integers(len(solid)))]
        top, left = int(row) - side // 2, int(column) - side // 2
        if top < 0 or left < 0 or top + side > person.rgba.shape[0] or left + side > person.rgba.shape[1]:
            continue
        common = np.minimum(high, [left + side, top + side]) - np.maximum(low, [left, top])
        if np.prod(np.clip(common, 0, None)) > MOST_FACE_OF_A_PART * side**2:
            continue
        part = person.rgba[top : top + side, left : left + side].copy()
        if rng.uniform() < 0.5:
            mask = np.zeros((side, side), dtype=np.uint8)
            cv2.ellipse(mask, (side // 2, side // 2), (side // 2, side // 2), 0, 0, 360, 255, -1, cv2.LINE_AA)
            part[..., 3] = mask
        else:
            part[..., 3] = 255
        return part
    return None
