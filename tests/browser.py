"""A headless browser for tests: what a page says on its console, what it looks like, what became of it."""

import base64
import fcntl
import json
import os
import select
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pix2face.files.images import decode_image

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
    "--hide-scrollbars",
    "--force-prefers-reduced-motion",
    "--remote-debugging-pipe",
)
WEBGL_FLAGS = ("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
LONGEST_S = 180
WHOLE = "new Promise(done => document.readyState === 'complete' ? done(1) : addEventListener('load', () => done(1)))"
# Textures are pictures that scripts load.
COUNT_PICTURES = """window.pictures = []; const Picture = window.Image; window.Image = function () {
    const own = new Picture();
    window.pictures.push(new Promise(done => ['load', 'error'].forEach(kind => own.addEventListener(kind, done))));
    return own; }"""
DRAWN = """Promise.all([...window.pictures, ...Array.from(document.images, own => own.decode().catch(() => 0))])
    .then(() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1)))))"""


def find_browser() -> str:
    """The program of a Chromium; the test is skipped where there is none."""
    found = next((path for path in map(shutil.which, NAMES) if path), None)
    if found is None:
        pytest.skip("no Chromium on this machine: sh scripts/install_chromium.sh")
    return found


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
        self.call("Page.enable")
        self.call("Page.addScriptToEvaluateOnNewDocument", source=COUNT_PICTURES)

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
            if message.get("method") in ("Runtime.consoleAPICalled", "Runtime.exceptionThrown", "Log.entryAdded"):
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

    def show(self, page: Path, width_px: int = 1000, height_px: int = 600) -> np.ndarray:
        """Opens another page from the disk, and returns what it looks like when its scripts have run (RGB)."""
        self.call("Log.enable")  # what the page's policy refuses, too
        size = {"width": width_px, "height": height_px, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        self.console.clear()
        self.call("Page.navigate", url=page.absolute().as_uri())
        for expression in (WHOLE, DRAWN):
            self.evaluate(expression)
        return decode_image(base64.b64decode(self.call("Page.captureScreenshot")["data"]), "the screenshot")

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
def opened_browser(folder: Path, graphics: Sequence[str] = WEBGL_FLAGS) -> Iterator[OpenPage]:
    """A browser with an empty page, without a network, for as long as the block lasts."""
    (from_us, requests), (answers, from_browser) = os.pipe(), os.pipe()
    options = [*FLAGS, *graphics, "--window-size=1000,800", f"--user-data-dir={folder / 'profile'}", "about:blank"]
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
            yield OpenPage(requests, answers)
        finally:
            os.close(requests)  # upon which the browser ends
            try:
                browser.wait(20)
            except subprocess.TimeoutExpired:
                browser.kill()
            os.close(answers)


@contextmanager
def opened(page: Path, folder: Path) -> Iterator[OpenPage]:
    """Opens a page from the disk that needs no graphics."""
    with opened_browser(folder, ["--disable-gpu"]) as browser:
        browser.call("Page.navigate", url=page.absolute().as_uri())
        browser.evaluate(WHOLE)
        yield browser
