"""A full disk is an ordinary error, wherever in an HDF5 file it comes."""

import io
from pathlib import Path

import h5py
import numpy as np
import pytest

from pix2face.files.hdf5_writing import UnfailingFile
from tests.full_disk import FULL, files_of_at_most


def write_table(path: Path) -> None:
    with UnfailingFile(path) as unfailing, h5py.File(unfailing, "w", track_order=False) as file:
        file.attrs["format"] = "table"
        file.create_dataset("chunks", data=np.arange(5000), chunks=(1000,), compression="gzip", track_times=False)
        file.create_dataset("group/plain", data=np.arange(5000.0), track_times=False)


def test_what_is_written_is_what_the_library_itself_writes(tmp_path: Path) -> None:
    write_table(tmp_path / "a.h5")
    with h5py.File(tmp_path / "a.h5", "r") as file:
        assert file["chunks"][...].tolist() == list(range(5000))
        assert file["group/plain"][...].tolist() == list(range(5000))
        assert file.attrs["format"] == "table"


def test_a_full_disk_is_one_error_wherever_it_comes(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    write_table(tmp_path / "a.h5")
    size = (tmp_path / "a.h5").stat().st_size
    for n_bytes in (0, 100, 1000, 3000, size // 2, size - 1):
        with files_of_at_most(n_bytes), pytest.raises(OSError, match=FULL):
            write_table(tmp_path / "b.h5")
    assert capfd.readouterr().err == ""


def test_long_work_can_look_whether_it_is_for_nothing(tmp_path: Path) -> None:
    unfailing = UnfailingFile(tmp_path / "a")
    with files_of_at_most(10):
        assert unfailing.write(b"0123456789") == 10
        unfailing.check()
        assert unfailing.write(b"x") == 1
        with pytest.raises(OSError, match=FULL):
            unfailing.check()
    unfailing.seek(0, io.SEEK_END)
    assert unfailing.tell() == 10
    unfailing.close()
