"""The Dockerfiles: accepted by their linter, short, and with what the project's own files say that it needs."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from datagen.doctor.doctor import NVIDIA_VENDOR_CONTENT, NVIDIA_VENDOR_FILE

ROOT = Path(__file__).parents[1]
NAMES = ("Dockerfile", "Dockerfile.nvidia")
LINTER = Path(sys.executable).with_name("hadolint")


def lint(*paths: Path) -> "subprocess.CompletedProcess[str]":
    if not LINTER.exists():
        pytest.skip("no hadolint: pip install 'pix2face[dev]'")
    return subprocess.run([LINTER, "--no-color", *paths], capture_output=True, text=True)


def test_the_linter_finds_nothing(tmp_path: Path) -> None:
    done = lint(*(ROOT / name for name in NAMES))
    assert (done.returncode, done.stdout) == (0, "")
    faulty = tmp_path / "Dockerfile"
    faulty.write_text((ROOT / "Dockerfile").read_text().replace("USER 1000", "RUN cd /tmp"))
    assert "DL3003" in lint(faulty).stdout


@pytest.mark.parametrize("name", NAMES)
def test_an_image_has_what_the_project_needs(name: str) -> None:
    text = (ROOT / name).read_text()
    assert text.count("\n") < 40
    (packages,) = re.findall('^PACKAGES="(.*)"$', (ROOT / "scripts" / "install_gl.sh").read_text(), re.MULTILINE)
    assert packages in text
    assert packages in (ROOT / "README.md").read_text()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    extras = re.findall("^ARG EXTRAS=(.*)$", text, re.MULTILINE)[0].split(",")
    assert set(extras) <= set(project["project"]["optional-dependencies"])
    copied = {path for line in re.findall("^COPY ([^-].*)$", text, re.MULTILINE) for path in line.split()[:-1]}
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {"pyproject.toml", project["project"]["readme"], *project["project"]["license-files"]}
    assert copied == needed | {"constraints.txt", *wheel["packages"], *wheel["force-include"]}
    ignored = (ROOT / ".dockerignore").read_text().splitlines()
    assert copied == {line.removeprefix("!") for line in ignored if line.startswith("!")}
    assert re.search("^USER [1-9]", text, re.MULTILINE)


def test_the_vendor_file_is_the_one_that_the_doctor_asks_for() -> None:
    text = (ROOT / "Dockerfile.nvidia").read_text()
    assert f"echo '{NVIDIA_VENDOR_CONTENT}' \\\n    > {NVIDIA_VENDOR_FILE}" in text
