"""Another reader finds in a ``.glb`` what was put into it."""

from pathlib import Path

import numpy as np
import pytest

from pix2face.files.meshes.glb import COLUMNS, VERTEX_DATA, GlbContent, Shape

pygltflib = pytest.importorskip("pygltflib", reason="pip install 'pix2face[dev]'")
ARRAYS: list[tuple[Shape, str, int]] = [
    ("SCALAR", "int32", pygltflib.UNSIGNED_INT),
    ("VEC2", "float64", pygltflib.FLOAT),
    ("VEC3", "float32", pygltflib.FLOAT),
    ("VEC4", "uint8", pygltflib.UNSIGNED_BYTE),
]
STORED = {pygltflib.UNSIGNED_INT: "<u4", pygltflib.FLOAT: "<f4", pygltflib.UNSIGNED_BYTE: "u1"}


@pytest.mark.parametrize("n_bytes", [4, 5, 7])
def test_arrays_and_pictures_come_back(tmp_path: Path, n_bytes: int) -> None:
    rng = np.random.default_rng(1)
    arrays = [rng.integers(0, 200, (5, COLUMNS[shape])).astype(dtype) for shape, dtype, _ in ARRAYS]
    content, picture = GlbContent(), rng.bytes(n_bytes)
    place = content.add_bytes(picture)  # first, so that it would put what follows at odd places
    numbers = [content.add(array, shape, VERTEX_DATA) for array, (shape, _, _) in zip(arrays, ARRAYS, strict=True)]
    (tmp_path / "a.glb").write_bytes(content.file({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": []}]}))
    read = pygltflib.GLTF2().load(str(tmp_path / "a.glb"))
    binary = read.binary_blob()

    def bytes_of(index: int) -> bytes:
        view = read.bufferViews[index]
        assert view.byteOffset % 4 == 0
        return binary[view.byteOffset : view.byteOffset + view.byteLength]

    assert read.buffers[0].byteLength == len(binary)
    assert bytes_of(place) == picture
    assert read.bufferViews[place].target is None
    for number, array, (shape, _, kind) in zip(numbers, arrays, ARRAYS, strict=True):
        own = read.accessors[number]
        assert (own.type, own.componentType, own.count) == (shape, kind, 5)
        assert bool(own.normalized) == (array.dtype == np.uint8)
        found = np.frombuffer(bytes_of(own.bufferView), STORED[kind]).reshape(5, -1)
        np.testing.assert_array_equal(found, array)
        assert (own.min, own.max) == (array.min(axis=0).tolist(), array.max(axis=0).tolist())
        assert read.bufferViews[own.bufferView].target == VERTEX_DATA
