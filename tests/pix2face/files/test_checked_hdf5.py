"""HDF5 files that point elsewhere or declare more than they hold."""

import fcntl
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from pix2face.errors import InputFileError
from pix2face.files.checked_hdf5 import fixed_text, open_hdf5, read_array, read_text, read_version
from pix2face.models.morphable_model import load_model
from tests.model_files import write_small_head


def refused(path: Path, message: str) -> None:
    with pytest.raises(InputFileError, match=message), open_hdf5(path):
        pass


def test_external_links_are_refused_by_name(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["secret"] = np.zeros(3)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["shape/model/mean"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/secret")
    refused(tmp_path / "a.h5", "that /shape/model/mean links elsewhere")


def test_soft_links_are_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["b"] = h5py.SoftLink("/nowhere")
    refused(tmp_path / "a.h5", "that /b links elsewhere")


def test_external_storage_is_refused(tmp_path: Path) -> None:
    (tmp_path / "passwords").write_bytes(bytes(80))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("mean", shape=(10,), dtype="f8", external=[(str(tmp_path / "passwords"), 0, 80)])
    refused(tmp_path / "a.h5", "that mean is stored outside|that /mean is stored outside")


def test_virtual_data_are_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["x"] = np.zeros(10)
    layout = h5py.VirtualLayout(shape=(10,), dtype="f8")
    layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "x", shape=(10,))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_virtual_dataset("mean", layout)
    refused(tmp_path / "a.h5", "is stored outside")


@pytest.mark.parametrize("chunks", [None, (1024,)])
def test_declared_sizes_are_held_against_the_file(tmp_path: Path, chunks: tuple[int] | None) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        data = file.create_dataset("mean", shape=(10**13,), dtype="f8", chunks=chunks)
        if chunks:
            data[:1024] = 1.0
    refused(tmp_path / "a.h5", "80000000000000 bytes declared")


def test_compressed_arrays_within_reason_are_read(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("mean", data=np.zeros(10**6), compression="gzip", compression_opts=9)
    with open_hdf5(tmp_path / "a.h5") as file:
        assert read_array(file, "mean", tmp_path / "a.h5").sum() == 0


def test_groups_that_contain_themselves_end(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        group = file.create_group("b")
        group["b"] = group
        file["c"] = file["/"]
    with open_hdf5(tmp_path / "a.h5") as file:
        assert "b" in file


@pytest.mark.parametrize("name", ["nothing", "text", "group"])
def test_what_is_no_array_of_numbers_is_refused(tmp_path: Path, name: str) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["text"] = "words"
        file.create_group("group")
    with (
        pytest.raises(InputFileError, match=f"expected numbers at {name}"),
        open_hdf5(tmp_path / "a.h5") as opened,
    ):
        read_array(opened, name, tmp_path / "a.h5")


def test_the_projects_own_files_are_checked_too(tmp_path: Path) -> None:
    path = write_small_head(tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        del file["mean"]
        file["mean"] = h5py.ExternalLink("/elsewhere.h5", "/mean")
    with pytest.raises(InputFileError, match="links elsewhere"):
        load_model(path)
    path = write_small_head(tmp_path / "b.h5")
    with h5py.File(path, "r+") as file:
        file["polygons"][0, 0] = 10**6
    with pytest.raises(InputFileError, match="tables fit its 2331 vertices"):
        load_model(path)


def test_text_of_fixed_length_comes_back(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name, text in (("plain", "words"), ("empty", ""), ("wide", "Zhu & Büchse")):
            file.attrs[name] = fixed_text(text)
            file[name] = np.array([text.encode()])
    with open_hdf5(tmp_path / "a.h5") as file:
        assert [read_text(file.attrs, tmp_path, name) for name in ("plain", "empty", "wide")] == [
            "words",
            "",
            "Zhu & Büchse",
        ]
        assert read_text(file["wide"], tmp_path) == "Zhu & Büchse"


def test_text_of_variable_length_is_refused(tmp_path: Path) -> None:
    """Its length is believed by the library: damaged, it ends the process (`python -m tests.fuzz` found one)."""
    path = write_small_head(tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        file.attrs["licence"] = "of variable length"
    with pytest.raises(InputFileError, match="expected text of fixed length at licence"):
        load_model(path)
    with h5py.File(path, "r+") as file:
        file["words"] = "of variable length"
    with pytest.raises(InputFileError, match="words is no array of numbers"):
        load_model(path)
    with (
        pytest.raises(InputFileError, match="expected text of fixed length at /words"),
        open_hdf5(path) as opened,
    ):
        read_text(opened["words"], path)


def test_attributes_that_are_missing_or_no_text_are_named(tmp_path: Path) -> None:
    path = write_small_head(tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        file.attrs["licence"] = 3
    with pytest.raises(InputFileError, match="fixed length at licence"):
        load_model(path)
    with h5py.File(path, "r+") as file:
        del file.attrs["licence"]
    with pytest.raises(InputFileError, match="expected text at licence"):
        load_model(path)


def test_reading_needs_no_locks(tmp_path: Path) -> None:
    """HDF5 would lock what it reads, which fails where a file system has no locks, or another program holds one."""
    path = tmp_path / "locked.h5"
    with h5py.File(path, "w") as file:
        file["values"] = np.arange(3)
    with path.open("rb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(OSError, match="unable to lock file"), h5py.File(path, "r", locking=True):
            pass
        with open_hdf5(path) as file:
            assert read_array(file, "values", path).tolist() == [0, 1, 2]


def test_arrays_may_not_unfold_to_far_more_than_the_file(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        for name in "abc":
            file.create_dataset(name, data=np.zeros(3 << 20), compression="gzip", chunks=(3 << 20,))
    refused(tmp_path / "a.h5", "/b to hold what it declares, found 25165824 bytes declared")


@pytest.mark.parametrize("version", [np.inf, 2.0, [2], "2", h5py.Empty("i4"), None])
def test_a_version_is_a_whole_number(tmp_path: Path, version: object) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        if version is not None:
            file.attrs["schema_version"] = version
    with (
        pytest.raises(InputFileError, match="expected a whole number as schema_version"),
        open_hdf5(tmp_path / "a.h5") as opened,
    ):
        read_version(opened.attrs, tmp_path / "a.h5")


def test_arrays_in_many_small_chunks_are_refused(tmp_path: Path) -> None:
    """The library takes kilobytes for each chunk, written or not."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("mean", (1 << 24,), "u1", chunks=(64,), compression="gzip")
    refused(tmp_path / "a.h5", "expected /mean to hold what it declares")


@pytest.mark.parametrize("left_out", [0, 1])
def test_chunks_that_unfold_to_less_than_they_declare_are_refused(tmp_path: Path, left_out: int) -> None:
    """The library reads beyond their end, which shows memory or ends the process."""
    content = bytes(399)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        mean = file.create_dataset("mean", (100,), "f4", chunks=(100,), compression="gzip")
        mean.id.write_direct_chunk((0,), content if left_out else zlib.compress(content), filter_mask=left_out)
    refused(tmp_path / "a.h5", "a chunk of /mean to hold what it declares, found 400 bytes declared and 399 stored")


@pytest.mark.parametrize("options", [{}, {"shuffle": True, "fletcher32": True}, {"compression": "lzf"}])
def test_chunks_of_all_filters_are_read(tmp_path: Path, options: dict[str, object]) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("mean", data=np.arange(250.0), chunks=(100,), **{"compression": "gzip", **options})
    with open_hdf5(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(file["mean"], np.arange(250.0))
