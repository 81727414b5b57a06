"""Backdrops from a folder of the user's own pictures."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.images import in_whole_numbers, read_bytes, read_size_px
from pix2face.files.opening import is_folder, walk_files
from pix2face.files.picture_head import declared_size_px

SUFFIXES = (".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp")
# Large pictures are decoded at a half, a quarter or an eighth of their size, if that is enough.
_REDUCED = {8: cv2.IMREAD_REDUCED_COLOR_8, 4: cv2.IMREAD_REDUCED_COLOR_4, 2: cv2.IMREAD_REDUCED_COLOR_2}


@lru_cache(maxsize=4)
def list_pictures(folder: str) -> tuple[str, ...]:
    """Lists all pictures in a folder and its subfolders, sorted, as relative paths. Results are cached.

    Raises:
        InputFileError: There is no such folder, it has no pictures, or a picture's size cannot be read.
    """
    root = Path(folder)
    if not is_folder(root):
        raise InputFileError(f"{folder}: expected a folder of pictures for backdrops, found none")
    names = sorted(path.relative_to(root).as_posix() for path in walk_files(root, SUFFIXES))
    if not names:
        raise InputFileError(f"{folder}: expected pictures ({', '.join(SUFFIXES)}) for backdrops, found none")
    for name in names:
        with _named_as_backdrop():
            read_size_px(root / name)
    return tuple(names)


def read_crop(
    folder: str, name: str, crop: tuple[float, float, float], height: int, width: int
) -> UInt8[ndarray, "h w 3"]:
    """Reads a crop of a picture in sRGB, resized to a height and width.

    Args:
        folder: Folder of the pictures.
        name: A path that `list_pictures` returned.
        crop: Horizontal and vertical position in the free space (0 is left and top, 1 right and bottom), and size as a
            share of the largest crop with this aspect ratio.
        height: Height of the result in pixels.
        width: Width of the result in pixels.

    Raises:
        InputFileError: The picture is missing or truncated.
    """
    path = Path(folder) / name
    with _named_as_backdrop():
        content = in_whole_numbers(read_bytes(path), str(path))
        finer = min(declared_size_px(content, str(path))) * crop[2] / max(height, width)
    picture = _decode(content, finer, path)
    rows, columns = picture.shape[:2]
    scale = crop[2] * min(rows / height, columns / width)
    part_height, part_width = max(1, round(scale * height)), max(1, round(scale * width))
    top, left = round(crop[1] * (rows - part_height)), round(crop[0] * (columns - part_width))
    part = picture[max(top, 0) : top + part_height, max(left, 0) : left + part_width]
    kind = cv2.INTER_AREA if part_height > height else cv2.INTER_LINEAR
    return np.ascontiguousarray(cv2.resize(part, (width, height), interpolation=kind)[..., ::-1], dtype=np.uint8)


@contextmanager
def _named_as_backdrop() -> Iterator[None]:
    """Adds what to do to the error of a picture that cannot be read."""
    try:
        yield
    except InputFileError as error:
        raise InputFileError(f"{error}; take it out of the folder of backdrops") from error


def _decode(content: bytes, finer: float, path: Path) -> UInt8[ndarray, "h w 3"]:
    """Decodes a picture that is `finer` times finer than needed, at a reduced size if possible."""
    flags = next((flag for factor, flag in _REDUCED.items() if finer >= factor), cv2.IMREAD_COLOR)
    # imread would fill missing parts of a JPEG with grey.
    with suppress(cv2.error):
        picture = cv2.imdecode(np.frombuffer(content, dtype=np.uint8), flags)
        if picture is not None:
            return np.asarray(picture, dtype=np.uint8)
    raise InputFileError(
        f"{path}: expected a picture for backdrops, found one that breaks off; take it out of the folder"
    )
