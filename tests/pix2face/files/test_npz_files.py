"""Archives of arrays are read as far as their files hold them."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from pix2face.errors import InputFileError
from pix2face.files.npz_files import npz_names, read_npy, read_npz


def test_arrays_come_back(tmp_path: Path) -> None:
    arrays = {
        "a": np.arange(6.0).reshape(2, 3),
        "b": np.array(["x", "é"]),
        "c": np.asfortranarray(np.ones((2, 2), "i2")),
    }
    np.savez_compressed(tmp_path / "a.npz", **arrays)
    assert npz_names(tmp_path / "a.npz", 1 << 20) == ("a", "b", "c")
    found = read_npz(tmp_path / "a.npz", ("c", "a", "b", "d"), "arrays", 1 << 20)
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_other_compressions_are_refused(tmp_path: Path, method: int) -> None:
    np.save(tmp_path / "a.npy", np.zeros(10**6))
    with zipfile.ZipFile(tmp_path / "a.npz", "w", method) as archive:
        archive.write(tmp_path / "a.npy", "a.npy")
    assert (tmp_path / "a.npz").stat().st_size < 2000
    with pytest.raises(InputFileError, match=r"a\.npz: expected arrays.*by other means than deflate"):
        read_npz(tmp_path / "a.npz", ("a",), "arrays", 1 << 20)


def test_all_arrays_together_are_bounded(tmp_path: Path) -> None:
    np.savez_compressed(tmp_path / "a.npz", a=np.zeros(3 << 20), b=np.zeros(3 << 20))
    assert len(read_npz(tmp_path / "a.npz", ("b",), "arrays", 1 << 20)["b"]) == 3 << 20
    with pytest.raises(InputFileError, match=r"b\.npy declares float64 \(3145728,\)"):
        read_npz(tmp_path / "a.npz", ("a", "b"), "arrays", 1 << 20)


def test_objects_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", a=np.array([{}]))
    with pytest.raises(InputFileError, match=r"a\.npz: .*declares object"):
        read_npz(tmp_path / "a.npz", ("a",), "arrays", 1 << 20)


def test_an_npy_file_may_not_declare_more_than_it_holds(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    np.save(path, np.arange(6.0).reshape(2, 3))
    np.testing.assert_array_equal(read_npy(path, "numbers", 1000), np.arange(6.0).reshape(2, 3))
    path.write_bytes(path.read_bytes().replace(b"(2, 3)", b"(2,99)"))
    with pytest.raises(InputFileError, match=r"a\.npy: expected numbers, .*the file declares float64 \(2, 99\)"):
        read_npy(path, "numbers", 1000)
