"""The page of `pix2face page` does in a browser what `pix2face fit` does, with no file but itself and no network."""

import base64
import hashlib
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy import ndarray
from PIL import Image
from skimage.data import astronaut, brick

from pix2face import Pix2Face
from pix2face.commands.cli import main
from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.morphable_model import builtin_model
from tests.browser import OpenPage, opened

pytestmark = pytest.mark.xdist_group("reader page")  # its networks are loaded once
ASTRONAUT: ndarray = np.ascontiguousarray(astronaut())
READ = "new Promise(done => document.addEventListener('read', event => done(event.detail), {once: true}))"
LOADED = """new Promise(done => { const look = () => document.body.dataset.state === 'running'
    ? setTimeout(look, 50) : done(document.getElementById('status').textContent); look(); })"""
# What a button saves, as base64; `link.click()` of the page gets no further than here.
SAVED = """new Promise(done => {
    const reader = new FileReader();
    reader.onload = () => done(reader.result);
    URL.createObjectURL = blob => { reader.readAsDataURL(blob); return '#'; };
    document.getElementById('%s').click(); })"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "new" / "reader.html"
    assert main(["page", "--out", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def browser(page: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[OpenPage]:
    """The page, when its networks are loaded."""
    with opened(page, tmp_path_factory.mktemp("browser")) as found:
        assert found.evaluate(LOADED) == "Ready. Choose a photograph."
        yield found


@pytest.fixture(scope="module")
def fit() -> FaceFit:
    (found,) = Pix2Face.load().fit(ASTRONAUT)
    return found


def read(browser: OpenPage, path: Path) -> Any:
    """What the page says of a file that is chosen."""
    answer = browser.start(READ)
    browser.choose_file("#file", path)
    return browser.value(answer)


def write_astronaut(path: Path, image: ndarray = ASTRONAUT, **options: Any) -> Path:
    Image.fromarray(image).save(path, **options)
    return path


def distance(found: Any, fit: FaceFit) -> ndarray:
    """How far the landmarks are from those of a fit, in shares of the box."""
    assert fit.box is not None
    return np.linalg.norm(np.array(found["landmarks"]) - fit.landmarks2d, axis=1) / fit.box.longer_side


def test_it_loads_nothing_and_holds_the_licences(page: Path) -> None:
    text = page.read_text()
    assert len(text) < 33e6
    script = text[text.rindex("<script>") + 8 : text.rindex("</script>")]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    (policy,) = re.findall(r'Content-Security-Policy" content="([^"]+)"', text)
    allowed = dict(one.split(" ", 1) for one in policy.split("; "))
    assert allowed.keys() == {"default-src", "script-src", "style-src", "img-src"}
    assert allowed["default-src"] == "'none'"
    assert allowed["script-src"] == f"'sha256-{digest}' 'wasm-unsafe-eval'"
    assert allowed["img-src"] == "data:"
    assert re.findall(r"<(?:link|script|img|iframe)[^>]*(?:src|href)=\"(?!data:,\")", text) == []
    assert "MIT License" in text
    assert "CC0-1.0" in text


def test_landmarks_and_boxes_are_those_of_fit(browser: OpenPage, fit: FaceFit, tmp_path: Path) -> None:
    (face,) = read(browser, write_astronaut(tmp_path / "astronaut.png"))["faces"]
    assert fit.box is not None
    np.testing.assert_allclose(face["box"], fit.box.sides, atol=3)
    assert face["score"] == pytest.approx(fit.score, abs=0.05)
    assert distance(face, fit).mean() < 0.02
    assert distance(face, fit).max() < 0.1
    assert np.mean(face["visible"]) > 0.8
    status = browser.evaluate("document.getElementById('status').textContent")
    assert re.fullmatch(r"1 face\. Finding took \d+\.\d\d s, reading \d+\.\d\d s\.", status)


def test_a_network_in_one_part_finds_the_same(
    browser: OpenPage, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    photograph, network, page = (tmp_path / name for name in ("astronaut.png", "network.onnx", "whole.html"))
    (expected,) = read(browser, write_astronaut(photograph))["faces"]
    assert main(["export", "--out", str(network)]) == 0
    assert main(["page", "--checkpoint", str(network), "--out", str(page)]) == 0
    with opened(page, tmp_path_factory.mktemp("browser")) as whole:
        whole.evaluate(LOADED)
        (found,) = read(whole, photograph)["faces"]
    np.testing.assert_allclose(found["box"], expected["box"], atol=0.5)
    np.testing.assert_allclose(found["landmarks"], expected["landmarks"], atol=0.5)


def test_landmarks_of_the_user_are_not_mixed_with_predicted_ones(page: Path, tmp_path: Path) -> None:
    model, own, out = builtin_model(), tmp_path / "landmarks.json", tmp_path / "own.html"
    content = {"format": "pix2face-landmarks", "schema_version": 1, "scheme": IBUG68, "vertices": list(range(68))}
    own.write_text(json.dumps(content | {"model": {"name": model.name, "sha256": model.sha256}}))
    assert main(["page", "--landmarks", str(own), "--out", str(out)]) == 0
    assert '"mixes_predicted_landmarks": true' in page.read_text()
    assert '"mixes_predicted_landmarks": false' in out.read_text()


def test_the_picture_shows_landmarks_and_maps(browser: OpenPage, tmp_path: Path) -> None:
    (face,) = read(browser, write_astronaut(tmp_path / "astronaut.png"))["faces"]
    colours = {shown: pixels(browser, shown, [(250, 140), (226, 20)]) for shown in ("mask", "pncc", "offset", "none")}
    cheek, above = zip(*colours.values(), strict=True)
    assert len(set(cheek)) == 4
    assert len(set(above)) == 1
    assert colours["mask"][0] == (60, 255, 60)
    assert colours["pncc"][0][2] > 180  # the cheek is far in front of the middle of the head
    saved = base64.b64decode(browser.evaluate(SAVED % "save-picture").partition(",")[2])
    picture = cv2.imdecode(np.frombuffer(saved, np.uint8), cv2.IMREAD_COLOR_RGB).astype(int)
    assert picture.shape == (1600, 1600, 3)  # a small photograph is enlarged
    x, y = (np.array(face["landmarks"])[face["visible"]] * 1600 / 512).astype(int).T
    dots = picture[y, x]
    assert (dots[:, 1] > dots[:, 0] + 60).mean() > 0.9


def pixels(browser: OpenPage, shown: str, places: list[tuple[int, int]]) -> list[tuple[int, ...]]:
    """The colours of places (x, y) of the astronaut, with a map drawn over it."""
    browser.evaluate(
        f"document.getElementById('map').value = '{shown}'; document.getElementById('opacity').value = 100;"
        "document.getElementById('map').dispatchEvent(new Event('input'))"
    )
    at = "Array.from(document.getElementById('drawing').getContext('2d').getImageData({}, {}, 1, 1).data.slice(0, 3))"
    return [tuple(browser.evaluate(at.format(x * 1600 // 512, y * 1600 // 512))) for x, y in places]


def test_a_photograph_is_turned_by_its_tag(browser: OpenPage, fit: FaceFit, tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6  # to be turned clockwise by a quarter
    turned = write_astronaut(tmp_path / "turned.jpg", np.ascontiguousarray(np.rot90(ASTRONAUT)), exif=exif, quality=95)
    (face,) = read(browser, turned)["faces"]
    assert distance(face, fit).mean() < 0.02


def test_the_turn_button_makes_a_face_upright(browser: OpenPage, fit: FaceFit, tmp_path: Path) -> None:
    path = write_astronaut(tmp_path / "lying.png", np.ascontiguousarray(np.rot90(ASTRONAUT)))
    assert read(browser, path)["problem"].startswith("No face was found. Faces have to be upright")
    answer = browser.start(READ)
    browser.evaluate("document.getElementById('turn').click()")
    (face,) = browser.value(answer)["faces"]
    assert distance(face, fit).mean() < 0.02


def test_several_faces_in_a_huge_photograph(browser: OpenPage, fit: FaceFit, tmp_path: Path) -> None:
    picture = np.full((2560, 4608, 3), 90, np.uint8)
    picture[:, :2560] = cv2.resize(ASTRONAUT, None, fx=5, fy=5, interpolation=cv2.INTER_CUBIC)
    picture[:2048, 2560:] = cv2.resize(ASTRONAUT[:256, 94:350], None, fx=8, fy=8, interpolation=cv2.INTER_CUBIC)
    first, second = read(browser, write_astronaut(tmp_path / "two.jpg", picture))["faces"]  # the larger one first
    first["landmarks"] = (np.array(first["landmarks"]) - [2560, 0]) / 8 + [94, 0]
    second["landmarks"] = np.array(second["landmarks"]) / 5
    assert distance(first, fit).mean() < 0.03
    assert distance(second, fit).mean() < 0.03
    assert browser.evaluate("document.getElementById('status').textContent").startswith("2 faces. ")


def test_what_shows_no_face_is_told_in_plain_words(browser: OpenPage, tmp_path: Path) -> None:
    path = write_astronaut(tmp_path / "brick.png", brick())
    assert read(browser, path)["problem"].startswith("No face was found.")
    for name, content in (("notes.txt", b"no picture"), ("cut.png", path.read_bytes()[:1000])):
        (tmp_path / name).write_bytes(content)
        problem = read(browser, tmp_path / name)["problem"]
        assert problem.startswith(f"{name} could not be opened as a picture")
        assert browser.evaluate("document.getElementById('status').textContent") == problem
        assert browser.evaluate("document.body.dataset.state") == "failed"


@pytest.mark.parametrize(
    "event",
    [
        "new DragEvent('drop', {dataTransfer: given, cancelable: true})",
        "new ClipboardEvent('paste', {clipboardData: given})",
    ],
)
def test_photographs_are_dropped_and_pasted(browser: OpenPage, event: str) -> None:
    answer = browser.start(READ)
    browser.evaluate(
        "{ const given = new DataTransfer(); given.items.add(new File(['x'], 'given.png', {type: 'image/png'}));"
        f"document.dispatchEvent({event}); }}"
    )
    assert browser.value(answer)["problem"].startswith("given.png could not be opened")


def test_the_browser_may_not_connect_and_has_nothing_to_complain_of(browser: OpenPage) -> None:
    assert browser.evaluate("typeof SharedArrayBuffer") == "undefined"  # so a single thread must do
    assert browser.console == []
    refused = "fetch('https://example.org').then(() => 'connected', error => error.message)"
    assert browser.evaluate(refused) == "Failed to fetch"
