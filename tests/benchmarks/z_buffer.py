"""The plain z-buffer in C++ that rasterisers are compared with; compiled by g++ where there is one."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
from numpy import ndarray

from pix2face.geometry.camera import Camera

SOURCE = Path(__file__).with_suffix(".cpp")


class ZBuffer:
    """Draws PNCC as bytes, as a program that needs one map of a known mesh does."""

    def __init__(self, mean: ndarray, triangles: ndarray, folder: Path) -> None:
        library = folder / "z_buffer.so"
        subprocess.run(["g++", "-O3", "-shared", "-fPIC", "-o", library, SOURCE], check=True)
        self._draw = ctypes.CDLL(str(library)).draw
        self._triangles = np.ascontiguousarray(triangles, dtype=np.int32)
        low, extent = mean.min(axis=0), np.ptp(mean, axis=0)
        self._colours = np.ascontiguousarray((mean - low) / extent, dtype=np.float32)

    @staticmethod
    def is_available() -> bool:
        return shutil.which("g++") is not None

    def project(self, vertices: ndarray, camera: Camera) -> ndarray:
        """Vertices as it takes them: whole numbers are pixel centres, larger z is nearer."""
        screen = np.column_stack([camera.project(vertices) - 0.5, -camera.depth(vertices)])
        return np.ascontiguousarray(screen, dtype=np.float32)

    def draw(self, screen: ndarray, size_px: int) -> ndarray:
        image = np.zeros((size_px, size_px, 3), np.uint8)
        depth = np.full((size_px, size_px), -1e8, np.float32)
        arrays = (image, screen, self._triangles, self._colours, depth)
        pointers = (ctypes.c_void_p(array.ctypes.data) for array in arrays)
        self._draw(*pointers, len(self._triangles), size_px, size_px, 3, ctypes.c_float(1))
        return image
