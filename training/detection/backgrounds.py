"""Pictures without people, from a folder: what faces are pasted over, and what else is pasted."""

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import Final, final

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.files.images import read_bytes, read_photograph

SUFFIXES = (".jpg", ".jpeg", ".png", ".webp", ".bmp")
KEPT: Final = 5_000  # pictures that a process keeps


@final
class Backgrounds:
    """Parts of pictures.

    Args:
        folder: Searched with its subfolders. Its pictures are taken to show no face.

    Raises:
        UsageError: The folder holds no picture.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._paths = sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES)
        if not self._paths:
            raise UsageError(f"{folder}: expected pictures that show nobody, found none; `datagen empty` draws some")
        self._read = lru_cache(KEPT)(read_photograph)

    def sha256(self) -> str:
        """Hash of the names and contents of all pictures."""
        total = hashlib.sha256()
        for path in self._paths:
            total.update(path.relative_to(self._folder).as_posix().encode() + b"\0" + read_bytes(path))
        return total.hexdigest()

    def draw(self, rng: np.random.Generator, size_px: int) -> UInt8[ndarray, "s s 3"]:
        """A square part of one of them, in the given size."""
        picture = self._read(self._paths[int(rng.integers(len(self._paths)))])
        side = max(int(min(picture.shape[:2]) * np.sqrt(rng.uniform(0.1, 1))), 1)
        top, left = (int(rng.integers(extent - side + 1)) for extent in picture.shape[:2])
        part = picture[top : top + side, left : left + side]
        if rng.uniform() < 0.5:
            part = part[:, ::-1]
        kind = cv2.INTER_AREA if side > size_px else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(part, (size_px, size_px), interpolation=kind), dtype=np.uint8)
