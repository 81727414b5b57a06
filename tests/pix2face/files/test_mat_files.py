"""Arrays from MAT 5 files: what SciPy writes is read as it was, and no file that lies about its sizes costs much."""

import struct
import tracemalloc
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.face_files.w300lp import LARGEST_FILE_BYTES
from pix2face.files.mat_files import mat_names, read_mat
from tests.fuzz.damaged_grammars import damaged

NUMBER_DTYPES = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
names = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,30}", fullmatch=True)
numbers = st.sampled_from(NUMBER_DTYPES).flatmap(
    lambda dtype: hnp.arrays(dtype, hnp.array_shapes(min_dims=2, max_dims=5, min_side=0, max_side=7))
)
FIELDS: dict[str, Any] = {
    "x": np.arange(12.0).reshape(3, 4),
    "cell": np.array([1, "a"], dtype=object),
    "text": "words",
    "small": np.uint16([1, 2]),
    "complex": np.ones(3) * 1j,
    "structure": {"a": 1},
    "sparse": scipy.sparse.csc_matrix(np.eye(3)),
    "logical": np.array([True, False]),
    "y": np.zeros((0, 3)),
}
KINDS = {
    "cell": "a cell array",
    "text": "text",
    "complex": "complex numbers",
    "structure": "a structure",
    "sparse": "a sparse array",
}


@given(st.dictionaries(names, numbers, max_size=5), st.booleans())
def test_what_scipy_writes_is_read_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, variables: dict[str, ndarray], compressed: bool
) -> None:
    path = tmp_path_factory.mktemp("mat") / "a.mat"
    scipy.io.savemat(path, dict(variables), do_compression=compressed)
    found = read_mat(path, variables.keys())
    assert found.keys() == variables.keys()
    assert mat_names(path) == list(variables)
    for name, values in variables.items():
        assert (found[name].dtype, found[name].shape) == (values.dtype, values.shape)
        assert found[name].tobytes("F") == values.tobytes("F")


def test_the_files_at_hand_are_read(shared_dir: Path) -> None:
    paths = sorted((shared_dir / "data").rglob("*.mat"))
    assert len(paths) >= 403
    for path in [*paths, shared_dir / "models" / "bfm_mean" / "model_info.mat"]:
        expected = scipy.io.loadmat(path)
        found = read_mat(path, mat_names(path))
        assert len(found) >= 1
        for name, array in found.items():
            np.testing.assert_array_equal(array, expected[name])


@pytest.mark.parametrize("compressed", [False, True])
def test_only_what_was_asked_for_is_read_and_only_numbers(tmp_path: Path, compressed: bool) -> None:
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, FIELDS, do_compression=compressed)
    names = mat_names(path)
    assert [name for name in names if "." not in name] == list(FIELDS)
    assert [name for name in names if "." in name] == ["structure.a"]
    found = read_mat(path, ("x", "small", "y", "absent"))
    assert set(found) == {"x", "small", "y"}
    np.testing.assert_array_equal(found["x"], FIELDS["x"])
    assert found["y"].shape == (0, 3)
    np.testing.assert_array_equal(read_mat(path, ("logical",))["logical"], [[1, 0]])
    for name, kind in KINDS.items():
        with pytest.raises(InputFileError, match=rf"a\.mat.*{name} should be an array of numbers and is {kind}"):
            read_mat(path, ("x", name))


def with_version(content: bytes, version: bytes) -> bytes:
    return content[:124] + version + content[128:]


TEXT = b"MATLAB 5.0 MAT-file"
LITTLE_ENDIAN_5 = b"\x00\x01IM"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "0 bytes, too short"),
        (b"MATLAB 5.0", "10 bytes, too short"),
        (b"\x89HDF\r\n\x1a\n" + bytes(500), "no header of Matlab"),
        (with_version(bytes(200), LITTLE_ENDIAN_5), "unknown kind 0"),
    ],
)
def test_other_files_are_refused_for_what_they_are(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "face.mat"
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=rf"face\.mat: expected a MAT 5 file of numbers.*{message}.*save -v6 or"):
        read_mat(path, ("a",))


def element(kind: int, body: bytes) -> bytes:
    return struct.pack("<II", kind, len(body)) + body + bytes(-len(body) % 8)


def deflated(variable: bytes) -> bytes:
    packed = zlib.compress(variable)
    return struct.pack("<II", 15, len(packed)) + packed


def matrix(shape: tuple[int, ...], declared_bytes: int, data: bytes = b"", matlab_class: int = 6) -> bytes:
    """A variable ``a`` by hand, whose declared sizes need not be true."""
    body = element(6, struct.pack("<II", matlab_class, 0)) + element(5, struct.pack(f"<{len(shape)}i", *shape))
    body += element(1, b"a") + struct.pack("<II", 9, declared_bytes) + data
    return struct.pack("<II", 14, len(body)) + body


def file_of(*elements: bytes) -> bytes:
    return with_version(TEXT.ljust(128), LITTLE_ENDIAN_5) + b"".join(elements)


@contextmanager
def little_memory() -> Iterator[None]:
    """No more than 8 MB may be allocated meanwhile."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    "variable",
    [
        matrix((30_000, 30_000), 7_200_000_000 % 2**32),  # declares 7 GB
        matrix((2**31 - 1, 1), (2**31 - 1) * 8 % 2**32),
        matrix((1, 2), 4_000_000_000),
        matrix((2, 2), 32, bytes(24)),  # one number short
        matrix((2, 2), 24, bytes(24)),
        matrix((-2, -2), 32, bytes(32)),
        matrix((536_870_911, 1), 4_294_967_288),  # consistent, and 4 GB
        matrix((2**31 - 1, 1), 32, bytes(32), matlab_class=1),  # a cell array
        matrix((2**31 - 1, 1), 32, bytes(32), matlab_class=4),  # text
    ],
)
@pytest.mark.parametrize("compressed", [True, False])
def test_declared_sizes_are_not_believed(tmp_path: Path, variable: bytes, compressed: bool) -> None:
    path = tmp_path / "face.mat"
    path.write_bytes(file_of(deflated(variable) if compressed else variable))
    with little_memory(), pytest.raises(InputFileError, match=r"face\.mat"):
        read_mat(path, ("a",))


@pytest.mark.parametrize("name", ["a", "other"])
@pytest.mark.parametrize("shape", [(1, 1), (1000 * LARGEST_FILE_BYTES // 8, 1)])
def test_a_bomb_does_not_go_off(tmp_path: Path, name: str, shape: tuple[int, int]) -> None:
    """One compressed variable of 200 MB of zeros, whose size is a lie or not."""
    deflate = zlib.compressobj()
    packed = deflate.compress(matrix(shape, 1000 * LARGEST_FILE_BYTES)) + deflate.flush(zlib.Z_FULL_FLUSH)
    packed += 200 * (deflate.compress(bytes(1 << 20)) + deflate.flush(zlib.Z_FULL_FLUSH))  # nothing refers back
    path = tmp_path / "bomb.mat"
    path.write_bytes(file_of(struct.pack("<II", 15, len(packed)) + packed))
    with little_memory():
        if name == "a":
            with pytest.raises(InputFileError, match=r"bomb\.mat.*at most 4194304 are possible"):
                read_mat(path, ("a",), LARGEST_FILE_BYTES)
        else:
            assert read_mat(path, ("other",), LARGEST_FILE_BYTES) == {}


def test_a_long_array_of_zeros_is_read_unless_it_is_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    n = 3 << 20
    path.write_bytes(file_of(deflated(matrix((1, n), 8 * n, bytes(8 * n)))))
    assert path.stat().st_size < 8 * n / 900
    assert read_mat(path, ("a",))["a"].shape == (1, n)  # honest, if large
    content = path.read_bytes()
    path.write_bytes(content[:132] + struct.pack("<I", 64) + content[136:200])  # the same, cut to 64 bytes
    with pytest.raises(InputFileError, match="cannot be read"):
        read_mat(path, ("a",))


def test_a_flipped_bit_in_compressed_numbers_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "face.mat"
    scipy.io.savemat(path, {"a": np.random.default_rng(0).normal(size=200)}, do_compression=True)
    content = bytearray(path.read_bytes())
    content[600] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputFileError, match="cannot be read"):
        read_mat(path, ("a",))


def test_big_endian_files_are_read(tmp_path: Path) -> None:
    body = struct.pack(">IIII", 6, 8, 6, 0) + struct.pack(">IIii", 5, 8, 1, 2) + struct.pack(">HHBxxx", 1, 1, ord("a"))
    body += struct.pack(">IIdd", 9, 16, 1.5, -2.0)
    path = tmp_path / "a.mat"
    path.write_bytes(with_version(TEXT.ljust(128), b"\x01\x00MI") + struct.pack(">II", 14, len(body)) + body)
    np.testing.assert_array_equal(read_mat(path, ("a",))["a"], [[1.5, -2.0]])
    np.testing.assert_array_equal(scipy.io.loadmat(path)["a"], [[1.5, -2.0]])


@pytest.mark.parametrize("compressed", [False, True])
def test_damaged_files_are_refused_or_read_as_scipy_reads_them(tmp_path: Path, compressed: bool) -> None:
    """Where SciPy reads them: it fails on other damage than we do."""
    path, rng, n_refused = tmp_path / "face.mat", np.random.default_rng(0), 0
    fields = {"a": rng.normal(size=(199, 1)), "b": np.ones((1, 4), np.int16), "c": rng.normal(size=(3, 68))}
    scipy.io.savemat(path, fields, do_compression=compressed)
    content = path.read_bytes()
    for _ in range(100):
        path.write_bytes(damaged(content, rng))
        try:
            with little_memory():
                found = read_mat(path, ("a", "c"))
        except InputFileError:
            n_refused += 1
            continue
        expected: dict[str, ndarray] = {}
        with suppress(Exception), warnings.catch_warnings(action="ignore"):
            expected = scipy.io.loadmat(path, variable_names=list(found))
        for name in found.keys() & expected.keys():
            np.testing.assert_array_equal(found[name], expected[name])
    assert n_refused > 50


@pytest.mark.parametrize("compressed", [False, True])
def test_fields_of_a_structure_are_read_by_name(tmp_path: Path, compressed: bool) -> None:
    path, x, y = tmp_path / "a.mat", np.arange(6.0).reshape(2, 3), np.arange(40, dtype=np.float32)[:, None]
    fields = {"x": x, "text": "words", "nested": {"z": x}, "y": y, "one": 7}
    scipy.io.savemat(path, {"before": x, "model": fields, "after": y}, do_compression=compressed)
    found = read_mat(path, ["model.x", "model.y", "model.one", "after"])
    np.testing.assert_array_equal(found["model.x"], x)
    np.testing.assert_array_equal(found["model.y"], y)
    assert found["model.one"].item() == 7
    np.testing.assert_array_equal(found["after"], y)
    for name in ("model.text", "model.nested", "model"):
        with pytest.raises(InputFileError, match="should be an array of numbers"):
            read_mat(path, [name])
    content = path.read_bytes()
    for length in range(200, len(content), 41):
        path.write_bytes(content[:length])
        with pytest.raises(InputFileError, match="cannot be read"):
            mat_names(path)


def test_files_of_version_7_3_are_read_in_the_shapes_of_matlab(tmp_path: Path) -> None:
    path, x = tmp_path / "a.mat", np.arange(6.0).reshape(2, 3)
    with h5py.File(path, "w", userblock_size=512) as file:
        file["x"], file["model/y"] = x.T, x
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM")
    assert mat_names(path) == ["model.y", "x"]
    found = read_mat(path, ["x", "model.y", "absent"])
    np.testing.assert_array_equal(found["x"], x)
    np.testing.assert_array_equal(found["model.y"], x.T)
    path.write_bytes(path.read_bytes()[:600])
    with pytest.raises(InputFileError, match="expected an HDF5 file"):
        read_mat(path, ["x"])
