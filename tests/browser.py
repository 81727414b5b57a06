"""A headless browser for tests: what a page says on its console, what it looks like, what became of it."""

import base64
import fcntl
import json
import os
import re
import select
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
WHOLE = "new Promise(done => document.readyState === 'complete' ? done(1) : addEventListener('load', () => done(1)))"


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


class OpenPage:
    """A page that stays open: Chromium's DevTools protocol over two pipes, JSON that ends in a zero byte."""

    def __init__(self, requests: int, answers: int) -> None:
        self._requests, self._answers, self._unread, self._number = requests, answers, b"", 0
        self._session: dict[str, str] = {}
        self.console: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self._session = {"sessionId": session}
        self.call("Runtime.enable")

    def call(self, method: str, **parameters: Any) -> Any:
        """Calls a method of the protocol, and waits for its result."""
        return self.result(self.send(method, **parameters))

    def send(self, method: str, **parameters: Any) -> int:
        """Calls a method of the protocol; ``result`` waits for what comes of it."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters, **self._session}
        os.write(self._requests, json.dumps(message).encode() + b"\0")
        return self._number

    def result(self, number: int) -> Any:
        while True:
            message = self._read()
            if message.get("method") in ("Runtime.consoleAPICalled", "Runtime.exceptionThrown"):
                self.console.append(json.dumps(message["params"]))
            if message.get("id") == number:
                assert "error" not in message, message["error"]
                assert "exceptionDetails" not in message["result"], message["result"]
                return message["result"]

    def evaluate(self, expression: str) -> Any:
        """The value of an expression in the page; a promise is waited for."""
        return self.value(self.start(expression))

    def start(self, expression: str) -> int:
        return self.send("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)

    def value(self, number: int) -> Any:
        return self.result(number)["result"].get("value")

    def choose_file(self, selector: str, path: Path) -> None:
        """Chooses a file as a user does in the dialogue of an input element."""
        root = self.call("DOM.getDocument")["root"]["nodeId"]
        node = self.call("DOM.querySelector", nodeId=root, selector=selector)["nodeId"]
        self.call("DOM.setFileInputFiles", files=[str(path)], nodeId=node)

    def screenshot(self, path: Path) -> None:
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot")["data"]))

    def _read(self) -> Any:
        while b"\0" not in self._unread:
            assert select.select([self._answers], [], [], LONGEST_S)[0], "the browser does not answer"
            part = os.read(self._answers, 1 << 20)
            if not part and not self._session:
                pytest.skip("Chromium does not run here")
            assert part, "the browser has ended"
            self._unread += part
        message, self._unread = self._unread.split(b"\0", 1)
        return json.loads(message)


@contextmanager
def opened(page: Path, folder: Path, width_px: int = 1000, height_px: int = 800) -> Iterator[OpenPage]:
    """Opens a page from the disk, without a network, for as long as the block lasts."""
    (from_us, requests), (answers, from_browser) = os.pipe(), os.pipe()
    flags = [flag for flag in FLAGS if "gl=" not in flag and "swiftshader" not in flag]
    options = [*flags, "--disable-gpu", "--force-prefers-reduced-motion", f"--window-size={width_px},{height_px}"]
    options += [f"--user-data-dir={folder / 'profile'}", "--remote-debugging-pipe", "about:blank"]
    # The browser reads from its descriptor 3 and writes to its descriptor 4.
    passed = [fcntl.fcntl(descriptor, fcntl.F_DUPFD, 10) for descriptor in (from_us, from_browser)]
    os.close(from_us)
    os.close(from_browser)
    redirected = f'exec "$@" 3<&{passed[0]} 4>&{passed[1]}'
    command = ["bash", "-c", redirected, "bash", find_browser(), *options]
    with subprocess.Popen(command, pass_fds=passed, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as browser:
        for descriptor in passed:
            os.close(descriptor)
        try:
            opened_page = OpenPage(requests, answers)
            opened_page.call("Page.navigate", url=page.absolute().as_uri())
            opened_page.evaluate(WHOLE)
            yield opened_page
        finally:
            os.close(requests)  # upon which the browser ends
            try:
                browser.wait(20)
            except subprocess.TimeoutExpired:
                browser.kill()
            os.close(answers)
