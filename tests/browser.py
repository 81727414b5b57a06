"""A headless browser for tests: what a page says on its console, what it looks like, what became of it."""

import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from pix2face.files.images import read_photograph

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--enable-logging=stderr",
    "--hide-scrollbars",
)
LONGEST_S = 180


@dataclass(frozen=True, eq=False)
class Visit:
    """What was seen of a page.

    Attributes:
        picture: RGB.
        document: The page's elements when its scripts had run.
        console: Lines of the console, and errors of scripts.
    """

    picture: np.ndarray
    document: str
    console: list[str]


def find_browser() -> str:
    """The program of a Chromium; the test is skipped where there is none."""
    found = next((path for path in map(shutil.which, NAMES) if path), None)
    if found is None:
        pytest.skip("no Chromium on this machine: sh scripts/install_chromium.sh")
    return found


def visit(page: Path, folder: Path, width_px: int = 1000, height_px: int = 600) -> Visit:
    """Opens a page from the disk, without a network."""
    browser, shot = find_browser(), folder / "screenshot.png"
    address = page.absolute().as_uri()
    options = [*FLAGS, f"--window-size={width_px},{height_px}", "--virtual-time-budget=4000"]
    command = [
        browser,
        *options,
        f"--user-data-dir={folder / 'profile'}",
        f"--screenshot={shot}",
        "--dump-dom",
        address,
    ]
    run = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=LONGEST_S)
    if run.returncode and not shot.exists():
        pytest.skip(f"{browser} does not run here: {run.stderr.strip()[-200:]}")
    console = re.findall(r"^.*CONSOLE.*$", run.stderr, re.MULTILINE)
    return Visit(read_photograph(shot), run.stdout, console)
