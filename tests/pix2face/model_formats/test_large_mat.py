"""The reader of large MAT 5 arrays against SciPy's, and on files that lie about their sizes."""

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as numpy_strategies
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.model_formats.large_mat import mat_names, read_mat

FIELDS: dict[str, Any] = {
    "x": np.arange(12.0).reshape(3, 4),
    "cell": np.array([1, "a"], dtype=object),
    "text": "words",
    "small": np.uint16([1, 2]),
    "complex": np.ones(3) * 1j,
    "structure": {"a": 1},
    "y": np.zeros((0, 3)),
}


@given(
    array=numpy_strategies.arrays(
        st.sampled_from([np.float32, np.float64, np.int8, np.uint16, np.int32]),
        numpy_strategies.array_shapes(min_dims=2, max_dims=4, min_side=0, max_side=5),
    ),
    compressed=st.booleans(),
)
def test_agrees_with_scipy(tmp_path_factory: pytest.TempPathFactory, array: ndarray, compressed: bool) -> None:
    path = tmp_path_factory.mktemp("mat") / "a.mat"
    scipy.io.savemat(path, {"first": np.arange(3), "array": array}, do_compression=compressed)
    found = read_mat(path, ("array",))["array"]
    np.testing.assert_array_equal(found, scipy.io.loadmat(path)["array"])


@pytest.mark.parametrize("compressed", [False, True])
def test_passes_over_what_is_no_array_and_refuses_it_where_asked(tmp_path: Path, compressed: bool) -> None:
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, FIELDS, do_compression=compressed)
    assert mat_names(path) == list(FIELDS)
    found = read_mat(path, ("x", "small", "y", "absent"))
    assert set(found) == {"x", "small", "y"}
    np.testing.assert_array_equal(found["x"], FIELDS["x"])
    assert found["y"].shape == (0, 3)
    for name in ("cell", "text", "complex", "structure"):
        with pytest.raises(InputFileError, match=f"{name} is no array of real numbers"):
            read_mat(path, (name,))


def test_agrees_with_scipy_on_the_authors_files(shared_dir: Path) -> None:
    path = shared_dir / "models" / "bfm_mean" / "model_info.mat"
    expected = scipy.io.loadmat(path)
    found = read_mat(path, mat_names(path))
    assert len(found) == 7
    for name, array in found.items():
        np.testing.assert_array_equal(array, expected[name])


def hostile(shape: tuple[int, int], declared: int, content: bytes, *, compressed: bool) -> bytes:
    """A file with one variable "x" of doubles that declares what it likes."""
    body = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, *shape)
    body += struct.pack("<HH4s", 1, 1, b"x") + struct.pack("<II", 9, declared) + content
    element = struct.pack("<II", 14, len(body)) + body
    if compressed:
        packed = zlib.compress(element)
        element = struct.pack("<II", 15, len(packed)) + packed
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + element


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize(
    ("shape", "declared", "message"),
    [
        ((1, 2), 16, "cut off"),
        ((1, 500_000_000), 4_000_000_000, "at most .* are possible"),
        ((1, 2), 4_000_000_000, "declares 4000000000 bytes"),
        ((2**31 - 1, 2**31 - 1), 8, "of shape"),
        ((-1, 8), 8, "without a shape"),
    ],
)
def test_sizes_are_held_against_the_file(
    tmp_path: Path, shape: tuple[int, int], declared: int, message: str, compressed: bool
) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(hostile(shape, declared, b"\0" * 8, compressed=compressed))
    with pytest.raises(InputFileError, match=message):
        read_mat(path, ("x",))


def test_a_bomb_is_bounded_by_what_deflate_can_do(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    n = 4 << 20
    path.write_bytes(hostile((1, n), 8 * n, bytes(8 * n), compressed=True))
    assert path.stat().st_size < 8 * n / 900
    assert read_mat(path, ("x",))["x"].shape == (1, n)  # honest, if large
    content = path.read_bytes()
    path.write_bytes(content[:132] + struct.pack("<I", 64) + content[136:200])  # the same, cut to 64 bytes
    with pytest.raises(InputFileError, match=f"at most {64 * 1032} are possible"):
        read_mat(path, ("x",))


@pytest.mark.parametrize("content", [b"", b"abc", b"MATLAB 7.3 MAT-file".ljust(512), bytes(1000)])
def test_foreign_files_are_one_clear_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.mat"
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=r"a\.mat: expected a MAT 5 file"):
        read_mat(path, ("x",))
