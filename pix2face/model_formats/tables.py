"""Landmark tables of published topologies: commented text files with one row for each landmark."""

from importlib.resources import files

import numpy as np
from jaxtyping import Int32
from numpy import ndarray

from pix2face.geometry.landmarks import N_IBUG68

MISSING = -1


def table_rows(name: str) -> list[tuple[str, ...]]:
    """The rows of a table in ``landmark_tables/``, split into words, without comments."""
    text = (files("pix2face") / "model_formats" / "landmark_tables" / f"{name}.txt").read_text(encoding="utf-8")
    lines = (line.partition("#")[0].split() for line in text.splitlines())
    return [tuple(words) for words in lines if words]


def ibug68_vertices(name: str, n_vertices: int) -> Int32[ndarray, "68"]:
    """The vertex of each iBUG landmark in a published topology; ``MISSING`` where the table or the mesh has none."""
    vertices = np.full(N_IBUG68, MISSING, dtype=np.int32)
    for number, vertex in table_rows(name):
        if int(vertex) < n_vertices:
            vertices[int(number)] = int(vertex)
    return vertices
