"""The reader of small MAT 5 files against SciPy's, and against damage."""

import io
import struct
import tracemalloc
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.face_files.mat5 import LARGEST_ELEMENT_BYTES, names_in_mat5, read_mat5
from pix2face.face_files.w300lp import LARGEST_FILE_BYTES
from tests.fuzz_mat5 import fuzz

NUMBER_DTYPES = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
names = st.from_regex(r"[A-Za-z][A-Za-z0-9_]{0,30}", fullmatch=True)
numbers = st.sampled_from(NUMBER_DTYPES).flatmap(
    lambda dtype: hnp.arrays(dtype, hnp.array_shapes(min_dims=0, max_dims=5, min_side=0, max_side=7))
)


def mat_bytes(variables: dict[str, object], *, compressed: bool = True) -> bytes:
    file = io.BytesIO()
    scipy.io.savemat(file, variables, do_compression=compressed)
    return file.getvalue()


def by_scipy(content: bytes) -> dict[str, ndarray]:
    fields = scipy.io.loadmat(io.BytesIO(content))
    return {name: values for name, values in fields.items() if not name.startswith("__")}


def assert_same_bits(found: ndarray, expected: ndarray) -> None:
    assert found.dtype == expected.dtype
    assert found.shape == expected.shape
    assert found.tobytes("F") == expected.tobytes("F")


def test_all_files_at_hand_agree_with_scipy_bit_for_bit(shared_dir: Path) -> None:
    paths = sorted((shared_dir / "data").rglob("*.mat"))
    assert len(paths) >= 403
    for path in paths:
        content = path.read_bytes()
        expected = by_scipy(content)
        found = read_mat5(content, expected.keys(), path.name)
        assert found.keys() == expected.keys()
        for name, values in expected.items():
            assert_same_bits(found[name], values)


@settings(deadline=None)
@given(st.dictionaries(names, numbers, max_size=5), st.booleans())
def test_what_scipy_writes_is_read_as_scipy_reads_it(variables: dict[str, ndarray], compressed: bool) -> None:
    content = mat_bytes(dict(variables), compressed=compressed)
    found, expected = read_mat5(content, variables.keys(), "made.mat"), by_scipy(content)
    assert found.keys() == expected.keys() == variables.keys()
    for name, values in expected.items():
        assert_same_bits(found[name], values)


@pytest.mark.parametrize("compressed", [True, False])
def test_only_what_was_asked_for_is_read(compressed: bool) -> None:
    variables = {"a": np.arange(3.0), "b": np.arange(5), "text": "seven", "cell": np.array([1, "x"], dtype=object)}
    content = mat_bytes(variables, compressed=compressed)
    found = read_mat5(content, ("b", "absent"), "made.mat")
    assert list(found) == ["b"]
    np.testing.assert_array_equal(found["b"], [[0, 1, 2, 3, 4]])
    assert names_in_mat5(content) == ["a", "b", "text", "cell"]


@pytest.mark.parametrize(
    ("value", "found"),
    [
        ("seven", "text"),
        (np.array([1 + 2j]), "complex numbers"),
        ({"field": 1.0}, "a structure"),
        (np.array([1, "x"], dtype=object), "a cell array"),
        (scipy.sparse.csc_matrix(np.eye(3)), "a sparse array"),
    ],
)
def test_what_is_no_array_of_numbers_is_refused_by_name(value: object, found: str) -> None:
    content = mat_bytes({"wanted": value, "other": np.ones(2)})
    with pytest.raises(InputFileError, match=rf"face\.mat.*wanted should be an array of numbers and is {found}"):
        read_mat5(content, ("wanted",), "face.mat")
    assert list(read_mat5(content, ("other",), "face.mat")) == ["other"]


def with_version(content: bytes, version: bytes) -> bytes:
    return content[:124] + version + content[128:]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "0 bytes, too short"),
        (b"MATLAB 5.0", "10 bytes, too short"),
        (b"\x89HDF\r\n\x1a\n" + bytes(500), "no header of Matlab"),
        (with_version(bytes(200), b"\x01\x00MI"), "big-endian"),
        (with_version(bytes(200), b"\x00\x02IM"), r"MAT 7\.3"),
        (with_version(bytes(200), b"\x00\x01IM"), "unknown kind 0"),
    ],
)
def test_other_files_are_refused_for_what_they_are(content: bytes, message: str) -> None:
    with pytest.raises(InputFileError, match=message) as caught:
        read_mat5(content, ("a",), "face.mat")
    assert "save -v6 or -v7" in str(caught.value)


def element(kind: int, body: bytes) -> bytes:
    return struct.pack("<II", kind, len(body)) + body + bytes(-len(body) % 8)


def matrix(shape: tuple[int, ...], declared_bytes: int, data: bytes = b"", matlab_class: int = 6) -> bytes:
    """A variable ``a`` by hand, whose declared sizes need not be true."""
    body = element(6, struct.pack("<II", matlab_class, 0)) + element(5, struct.pack(f"<{len(shape)}i", *shape))
    body += element(1, b"a") + struct.pack("<II", 9, declared_bytes) + data
    return struct.pack("<II", 14, len(body)) + body


def file_of(*elements: bytes) -> bytes:
    return with_version(bytes(128), b"\x00\x01IM") + b"".join(elements)


@pytest.mark.parametrize(
    "variable",
    [
        matrix((30_000, 30_000), 7_200_000_000 % 2**32),  # declares 7 GB
        matrix((2**31 - 1, 1), (2**31 - 1) * 8 % 2**32),
        matrix((2, 2), 32, bytes(24)),  # one number short
        matrix((2, 2), 24, bytes(24)),
        matrix((-2, -2), 32, bytes(32)),
        matrix((536_870_911, 1), 4_294_967_288),  # consistent, and 4 GB
    ],
)
@pytest.mark.parametrize("compressed", [True, False])
def test_declared_sizes_are_not_believed(variable: bytes, compressed: bool) -> None:
    content = file_of(element(15, zlib.compress(variable)) if compressed else variable)
    tracemalloc.start()
    try:
        with pytest.raises(InputFileError, match=r"face\.mat"):
            read_mat5(content, ("a",), "face.mat")
        assert tracemalloc.get_traced_memory()[1] < 8 * LARGEST_ELEMENT_BYTES
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", ["a", "other"])
def test_a_bomb_does_not_go_off(name: str) -> None:
    """A file of the largest size that is read, all of it one compressed variable of zeros: 4 GB."""
    n_bytes = 1000 * LARGEST_FILE_BYTES
    n_bytes -= n_bytes % 8
    deflate = zlib.compressobj()
    packed = deflate.compress(matrix((n_bytes // 8, 1), n_bytes))
    zeros = bytes(1 << 20)
    while len(packed) < 200_000:  # 200 MB of zeros are bomb enough for a test
        packed += deflate.compress(zeros)
    content = file_of(struct.pack("<II", 15, len(packed)) + packed)
    tracemalloc.start()
    try:
        if name == "a":
            with pytest.raises(InputFileError, match="cut off or larger than"):
                read_mat5(content, ("a",), "bomb.mat")
        else:
            assert read_mat5(content, ("other",), "bomb.mat") == {}
        assert tracemalloc.get_traced_memory()[1] < 8 * LARGEST_ELEMENT_BYTES
    finally:
        tracemalloc.stop()


def test_small_compressed_variables_are_bounded_by_what_deflate_can_do() -> None:
    body = zlib.compress(bytes(3_900_000), 9)
    assert len(body) < 4096
    with pytest.raises(InputFileError, match="unknown kind 0"):
        read_mat5(file_of(struct.pack("<II", 15, len(body)) + body), ("a",), "bomb.mat")


def test_a_flipped_bit_in_compressed_numbers_is_noticed() -> None:
    content = bytearray(mat_bytes({"a": np.random.default_rng(0).normal(size=200)}))
    content[600] ^= 1
    with pytest.raises(InputFileError, match="cannot be read"):
        read_mat5(bytes(content), ("a",), "face.mat")


@pytest.mark.parametrize("seed", [0, 1])
def test_no_damage_hangs_crashes_or_grows(seed: int) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # SciPy, the oracle, warns about much of it
        result = fuzz(cases=100, seed=seed)
    assert result.cases == 100
    assert result.refused > 50
    assert result.slowest_ms < 1000
    assert result.largest_mb < 8
    assert result.disagreements == ()
