"""Another reader finds in a ``.ply`` what was put into it."""

from io import BytesIO

import numpy as np
import pytest
import trimesh

from pix2face.files.meshes.ply import encode_ply

RNG = np.random.default_rng(1)
POINTS = RNG.normal(0, 50, (30, 3)).astype(np.float32)
COLOURS = RNG.integers(0, 256, (30, 3)).astype(np.uint8)
TRIANGLES = np.arange(30, dtype=np.int32).reshape(10, 3)[::-1]


@pytest.mark.parametrize("colours", [COLOURS, None])
def test_meshes_come_back(colours: np.ndarray | None) -> None:
    read = trimesh.load(BytesIO(encode_ply(POINTS, colours, TRIANGLES)), file_type="ply", process=False)
    np.testing.assert_array_equal(read.vertices, POINTS)
    np.testing.assert_array_equal(read.faces, TRIANGLES)
    assert read.visual.kind == (None if colours is None else "vertex")
    if colours is not None:
        np.testing.assert_array_equal(read.visual.vertex_colors, np.column_stack([colours, np.full(30, 255)]))


def test_points_come_back() -> None:
    read = trimesh.load(BytesIO(encode_ply(POINTS, COLOURS)), file_type="ply")
    assert isinstance(read, trimesh.PointCloud)
    np.testing.assert_array_equal(read.vertices, POINTS)
    np.testing.assert_array_equal(read.colors, np.column_stack([COLOURS, np.full(30, 255)]))
