"""Reads the pictures and HDF5 files in the package that appearances are made from."""

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import as_file, files

import cv2
import h5py
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.errors import InputFileError

_ASSETS = files("datagen") / "assets"


@contextmanager
def open_asset(name: str) -> Iterator[h5py.File]:
    """Opens an HDF5 file for reading."""
    with as_file(_ASSETS / name) as path, h5py.File(path, "r", locking=False) as file:
        yield file


def read_picture(name: str) -> UInt8[ndarray, "h w c"]:
    """Reads a picture, which has one channel or is RGB or RGBA.

    Raises:
        InputFileError: The file is damaged.
    """
    decoded = cv2.imdecode(np.frombuffer((_ASSETS / name).read_bytes(), dtype=np.uint8), cv2.IMREAD_UNCHANGED)
    if decoded is None:
        raise InputFileError(f"datagen/assets/{name}: expected a picture, found a damaged file; install again")
    picture = np.atleast_3d(np.asarray(decoded, dtype=np.uint8))
    return picture if picture.shape[2] == 1 else np.take(picture, [2, 1, 0, 3][: picture.shape[2]], axis=2)
