"""The page shows the face in any browser, needs nothing from the network, and trusts no name."""

import base64
import json
import os
import re
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote_to_bytes

import numpy as np
import pytest
from numpy import ndarray

from pix2face.fitting.face_fit import FaceFit
from pix2face.models.morphable_model import MorphableModel
from pix2face.photographs.view_page import FACES_A_PAGE, ViewedFace, ViewPages, face_data, view_page
from tests.browser import OpenPage, opened_browser
from tests.pix2face.photographs.seen_faces import photographed_face
from tests.synthetic_models import small_head_model
from tests.textured_head import textured_head

PLAIN, TEXTURED = small_head_model(), textured_head()
HOSTILE = (
    "</script><img src=x onerror=alert(1)>",
    "<!--<script>",
    "\"'><svg onload=alert(1)>",
    "a&amp;b\u2028\x1b[31m",
    "caf\udce9",
    "${1}{0}{x}",
)
BROWSERS = pytest.mark.xdist_group("view page")  # one is enough
BACKGROUND = np.array([0x20, 0x24, 0x2A])


def viewed(model: MorphableModel, name: str = "person") -> ViewedFace:
    return replace(person(model), name=name)


@cache
def person(model: MorphableModel) -> ViewedFace:
    face = photographed_face(model)
    landmarks3d = face.vertices[model.landmarks["ibug68"]].astype(np.float64)
    fit = FaceFit(face.camera, face.identity, face.expression, model, face.landmarks2d, landmarks3d)
    maps = face.maps()
    points = maps.pncc[maps.mask] + maps.offset[maps.mask]
    return ViewedFace("person", face.photograph(), fit, points, np.full(points.shape, 200, np.uint8))


@cache
def plain_page() -> str:
    return view_page([face_data(viewed(PLAIN))], "faces")


class Elements(HTMLParser):
    """Tags with their attributes, and the text of each script."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[str] = []
        self.title, self._inside = "", ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._inside = tag
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside == "script":
            self.scripts[-1] += data
        if self._inside == "title":
            self.title += data


def numbers(text: str, dtype: str) -> ndarray:
    return np.frombuffer(base64.b64decode(text), dtype=dtype)


@pytest.mark.parametrize("model", [PLAIN, TEXTURED])
def test_the_page_holds_the_mesh_of_the_fit(model: MorphableModel) -> None:
    face = viewed(model)
    elements = Elements(view_page([face_data(face)], "faces"))
    (data,) = json.loads(elements.scripts[0])
    positions = numbers(data["positions"], "<f4").reshape(-1, 3)
    triangles = numbers(data["triangles"], "<u4").reshape(-1, 3)
    np.testing.assert_allclose(positions[triangles], face.fit.vertices[model.triangles])
    np.testing.assert_allclose(numbers(data["points"], "<f4").reshape(-1, 3), face.points)
    assert data["name"] == "person"
    assert len(data["landmarks2d"]) == 68
    if model.uv is not None:
        uv = numbers(data["uv"], "<f4").reshape(-1, 2)[triangles]
        np.testing.assert_allclose(uv, model.uv[model.uv_triangles])


@pytest.mark.parametrize("name", HOSTILE)
def test_names_are_text_and_nothing_else(name: str) -> None:
    page = view_page([face_data(viewed(PLAIN, name))], name)
    elements = Elements(page.encode("utf-8", "backslashreplace").decode())
    assert [tag for tag, _ in elements.tags] == [tag for tag, _ in Elements(plain_page()).tags]
    assert len(elements.scripts) == 2
    shown = json.loads(elements.scripts[0])[0]["name"]
    assert shown == elements.title
    assert shown == name.translate({27: "\\x1b", 0x2028: "\\u2028", 0xDCE9: "\\udce9"})


def test_nothing_comes_from_elsewhere_and_only_the_viewer_runs() -> None:
    elements = Elements(plain_page())
    for tag, attributes in elements.tags:
        assert tag not in ("link", "iframe", "base")
        assert not {"src", "href"} & set(attributes)
        assert not any(name.startswith("on") for name in attributes)
    policy = next(a["content"] for tag, a in elements.tags if a.get("http-equiv") == "Content-Security-Policy")
    assert policy is not None
    assert "default-src 'none'" in policy
    assert re.search(r"script-src 'sha256-[\w+/=]{44}';", policy)


def write_pages(path: Path, n_faces: int) -> list[Path]:
    pages = ViewPages(path, "faces")
    for index in range(n_faces):
        pages.add(json.dumps({"name": str(index)}))
    pages.close()
    return pages.paths


def test_many_faces_come_on_pages_that_lead_to_each_other(tmp_path: Path) -> None:
    paths = write_pages(tmp_path / "a b#caf\udce9.html", 2 * FACES_A_PAGE + 1)
    elements = [Elements(path.read_text()) for path in paths]
    names = [[int(face["name"]) for face in json.loads(own.scripts[0])] for own in elements]
    assert names == [list(range(10)), list(range(10, 20)), [20]]
    links = [[a["href"] for tag, a in own.tags if tag == "a"] for own in elements]
    ways = [[tmp_path / os.fsdecode(unquote_to_bytes(str(link))) for link in own] for own in links]
    assert ways == [[paths[1]], [paths[0], paths[2]], [paths[1]]]


def test_a_full_page_is_the_only_one_and_no_face_makes_none(tmp_path: Path) -> None:
    (only,) = write_pages(tmp_path / "view.html", FACES_A_PAGE)
    assert "<nav>" not in only.read_text()
    assert write_pages(tmp_path / "none.html", 0) == []
    assert [path.name for path in tmp_path.iterdir()] == ["view.html"]


def test_pages_of_a_longer_run_go_and_other_files_stay(tmp_path: Path) -> None:
    for number in (2, 4):
        (tmp_path / f"view-{number}.html").write_text("<!doctype html><p>mine")
    write_pages(tmp_path / "view.html", 1)
    assert len(list(tmp_path.iterdir())) == 3
    write_pages(tmp_path / "view.html", 2 * FACES_A_PAGE + 1)
    write_pages(tmp_path / "view.html", 1)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["view-4.html", "view.html"]


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OpenPage]:
    with opened_browser(tmp_path_factory.mktemp("browser")) as found:
        yield found


@BROWSERS
@pytest.mark.parametrize("model", [PLAIN, TEXTURED])
def test_a_browser_draws_the_face(model: MorphableModel, browser: OpenPage, tmp_path: Path) -> None:
    page = tmp_path / "view.html"
    names = ["</script><img src=x onerror=alert(1)>", "second"]
    text = view_page([face_data(viewed(model, name)) for name in names], names[0])
    page.write_text(text.replace('<img id="behind"', '<img hidden id="behind"'))  # the mesh alone
    picture, document = browser.show(page), browser.evaluate("document.documentElement.outerHTML")
    assert browser.console == []
    assert 'data-state="ready"' in document
    assert "Drag to turn" in document
    assert "&lt;/script&gt;&lt;img src=x onerror=alert(1)&gt;</option>" in document
    height, width = picture.shape[:2]
    stage = picture[height // 5 :, width // 2 :].astype(int)
    drawn = np.abs(stage - BACKGROUND).max(axis=2) > 20
    columns = np.nonzero(drawn)[1]
    assert 0.1 < drawn.mean() < 0.8
    # A head, in the middle, in the colours of the photograph: red is the most, and they vary.
    assert abs(columns.mean() / stage.shape[1] - 0.5) < 0.1
    assert 0.2 < np.ptp(columns) / stage.shape[1] < 0.98
    colours = stage[drawn]
    assert colours[:, 0].mean() > colours[:, 2].mean() + 20
    assert colours.std(axis=0).min() > 5
    photograph = picture[height // 5 :, : width // 2].astype(int)
    assert (np.abs(photograph - BACKGROUND).max(axis=2) > 20).mean() > 0.5
    # The mesh lies where the face is in the photograph: most of it has the colours that are at the same place there.
    assert np.mean(np.abs(stage - photograph)[drawn].max(axis=1) < 12) > 0.4


@BROWSERS
def test_the_mesh_lies_over_the_photograph(browser: OpenPage, tmp_path: Path) -> None:
    """Its landmarks are drawn where the photograph beside it has its own, to some pixels."""
    page = tmp_path / "view.html"
    page.write_text(plain_page().replace('id="show-landmarks"', 'id="show-landmarks" checked'))
    picture = browser.show(page, 1400, 800).astype(int)
    is_dot = (picture[..., 1] > 200) & (picture[..., 0] < 120) & (picture[..., 2] < 120)
    places, meshes = (np.argwhere(half) for half in (is_dot[:, :700], is_dot[:, 700:]))
    assert min(len(places), len(meshes)) > 68
    for statistic in (np.mean, np.min, np.max):  # the dots of the two are of different sizes
        assert np.abs(statistic(places, axis=0) - statistic(meshes, axis=0)).max() < 3


@BROWSERS
def test_a_browser_draws_points_and_landmarks_alone(browser: OpenPage, tmp_path: Path) -> None:
    text = plain_page()
    text = text.replace('id="show-mesh" checked', 'id="show-mesh"').replace('id="behind"', 'hidden id="behind"')
    for name in ("show-points", "show-landmarks"):
        text = text.replace(f'id="{name}"', f'id="{name}" checked')
    page = tmp_path / "view.html"
    page.write_text(text)
    picture = browser.show(page)
    assert browser.console == []
    height, width = picture.shape[:2]
    stage = picture[height // 5 :, width // 2 :].astype(int)
    grey = (np.abs(stage - 200) <= 3).all(axis=2)  # what the points were given: light survives the way to the screen
    green = (stage[..., 1] > 200) & (stage[..., 0] < 120) & (stage[..., 2] < 120)
    assert grey.mean() > 0.02
    assert 68 < green.sum() < 0.05 * green.size
    photograph = picture[height // 5 :, : width // 2].astype(int)
    dots = (photograph[..., 1] > 200) & (photograph[..., 0] < 120) & (photograph[..., 2] < 120)
    assert dots.sum() > 68


@BROWSERS
def test_a_page_that_fails_says_so(browser: OpenPage, tmp_path: Path) -> None:
    """That the test above can fail: data without a mesh are told on the page, in its state, and on the console."""
    page = tmp_path / "view.html"
    page.write_text(plain_page().replace('"positions"', '"no positions"'))
    browser.show(page)
    document = browser.evaluate("document.documentElement.outerHTML")
    assert 'data-state="failed"' in document
    assert "This page could not be shown" in document
    assert browser.console != []
