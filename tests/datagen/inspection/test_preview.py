"""Contact sheets and pages: every layer is drawn, names stay text, and a browser finds no fault with the page."""

import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy import ndarray

from datagen.cli import main
from datagen.inspection.layer_pictures import layer_mask, layer_picture, region_colour
from datagen.inspection.preview import HEADING_PX, contact_sheet, landmarks_in_sight, sample_tiles, spread_samples
from datagen.inspection.preview_page import LARGEST_SIDE_PX, json_for_html, preview_page
from pix2face.files.images import encode_image
from pix2face.shards.layers import DEFAULT_LAYERS, LAYER_NAMES, LAYERS, WHOLE_PICTURE_LAYERS
from pix2face.shards.sample import Sample
from pix2face.shards.shard_reader import ShardHeader
from pix2face.shards.shard_writing import write_shard
from tests.browser import opened_browser

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)>&lt;\u2028\"'"


def all_layers(height: int = 60, width: int = 40) -> dict[str, ndarray]:
    """A square of face on a larger square of head."""
    mask, head = np.zeros((2, height, width), dtype=bool)
    mask[20:40, 10:30], head[10:50, 5:35] = True, True
    x = np.linspace(-1, 1, width, dtype=np.float32)[None, :, None] * mask[..., None]
    return {
        "pncc": x * np.float32([90, 60, 30]),
        "offset": x * np.float32([5, -5, 0]),
        "mask": mask,
        "depth": x[..., 0] * 50 + mask * np.float32(600),
        "normals": mask[..., None] * np.float32([0, 0, -1]),
        "uv": mask[..., None] * np.float32([0.25, 1.75]),
        "regions": head.astype(np.uint8) + mask,
        "seen": mask,
        "seen_regions": head.astype(np.uint8) + mask,
        "coverage": head.astype(np.float32),
    }


@pytest.fixture
def shards(tmp_path: Path, base: tuple[ShardHeader, Sample]) -> Path:
    """Four samples with every layer, in two shards, one of them with a name that would rather be markup."""
    header = replace(base[0], layers=LAYER_NAMES, region_names=("skin", HOSTILE))
    picture = encode_image(np.full((60, 40, 3), 77, np.uint8))
    sample = replace(base[1], image_bytes=picture, layers=all_layers(), landmarks2d=base[1].landmarks2d / 5)
    triplets = [replace(sample, sample_id=name) for name in ("one", "two", "three")]
    hostile = replace(sample, sample_id=HOSTILE, attributes={HOSTILE: HOSTILE, "yaw_deg": 12.34567})
    write_shard(tmp_path / "shards" / "shard-00000.h5", header, triplets)
    write_shard(tmp_path / "shards" / "shard-00001.h5", header, [hostile])
    return tmp_path / "shards"


@pytest.mark.parametrize("name", LAYERS)
def test_every_layer_is_drawn_where_it_holds_and_grey_elsewhere(name: str) -> None:
    layers = all_layers()
    picture, where = layer_picture(name, layers), layer_mask(name, layers)
    assert picture.shape == (60, 40, 3)
    assert where.sum() == (1200 if name in WHOLE_PICTURE_LAYERS else 400)
    assert (picture[~where] == 128).all()
    assert (picture[where] != 128).any(axis=-1).mean() > 0.9
    without_mask = {other: values for other, values in layers.items() if other != "mask"}
    if name in without_mask:
        assert (layer_mask(name, without_mask) <= where).all()


def test_the_colours_of_layers_mean_what_the_page_says() -> None:
    layers = all_layers()
    depth = layer_picture("depth", layers)[30, 10:30, 0]
    assert depth[0] == 255  # the nearest is white
    assert (np.diff(depth.astype(int)) <= 0).all()
    normals = layer_picture("normals", layers)[30, 20]
    assert normals[2] == 255  # towards the viewer is blue
    assert np.abs(normals[:2].astype(int) - 127).max() <= 1
    assert tuple(layer_picture("uv", layers)[30, 20]) == (63, 191, 127)
    assert tuple(layer_picture("regions", layers)[30, 20]) == region_colour(1)
    assert len({region_colour(i) for i in range(60)}) == 60


def test_a_depth_without_face_is_grey() -> None:
    layers = {"mask": np.zeros((8, 8), bool), "depth": np.zeros((8, 8), np.float32)}
    assert (layer_picture("depth", layers) == 128).all()


def test_samples_are_spread_over_all_shards(shards: Path) -> None:
    assert [sample.sample_id for _, sample in spread_samples(shards, 2)] == ["one", HOSTILE]
    assert [sample.sample_id for _, sample in spread_samples(shards, 99)] == ["one", "two", "three", HOSTILE]


@pytest.mark.parametrize(
    ("layers", "n_tiles"),
    [(LAYER_NAMES, 11), (DEFAULT_LAYERS, 4), (("pncc", "offset", "mask"), 2), (("image", "mask"), 2), (("depth",), 1)],
)
def test_a_sheet_shows_what_is_there(
    layers: tuple[str, ...], n_tiles: int, tmp_path: Path, base: tuple[ShardHeader, Sample]
) -> None:
    sample = replace(base[1], image_bytes=encode_image(np.full((60, 40, 3), 77, np.uint8)), layers=all_layers())
    write_shard(tmp_path / "few" / "shard-00000.h5", replace(base[0], layers=layers), [sample])
    sheet = contact_sheet(tmp_path / "few", 1)
    assert sheet.shape == (HEADING_PX + 180, 2 * 180 * n_tiles, 3)
    headings = np.split(sheet[:HEADING_PX], 2 * n_tiles, axis=1)
    assert all((heading < 128).any() for heading in headings)
    assert len({heading.tobytes() for heading in headings}) == n_tiles  # each column has one of its own
    page = read_page(preview_page("t", spread_samples(tmp_path / "few", 1)))
    assert [name for name, _, _ in page.data["layers"]] == [name for name in LAYERS if name in layers]
    assert (page.data["samples"][0]["image"] is not None) == ("image" in layers)


class Page(HTMLParser):
    """What a browser would see: elements, the data, and addresses that it would ask for."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[str] = []
        self.addresses: list[str] = []
        self.text: dict[str, str] = {}
        self.data: Any = None
        self._inside = ""
        self.feed(page)
        self.data = json.loads(self.text["samples"])

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        values = dict(attributes)
        self.elements.append(tag)
        self.addresses += [value for name, value in attributes if name in ("src", "href") and value]
        assert not any(name.startswith("on") for name in values)
        self._inside = values.get("id") or tag

    def handle_data(self, data: str) -> None:
        self.text[self._inside] = self.text.get(self._inside, "") + data

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""


def read_page(page: str) -> Page:
    return Page(page)


def test_names_stay_text(shards: Path) -> None:
    page = preview_page(HOSTILE, spread_samples(shards, 4))
    found = read_page(page)
    assert found.elements.count("script") == 2
    assert found.elements.count("img") == 2
    assert found.addresses == ["data:,"]
    assert found.text["h1"] == found.text["title"] == HOSTILE
    hostile = found.data["samples"][-1]
    assert hostile["id"] == HOSTILE
    assert hostile["attributes"] == [["", [[HOSTILE, HOSTILE, HOSTILE], ["yaw", "12.35°", "yaw_deg"]]]]
    assert found.data["regions"] == [["skin", "#f05a5a"], [HOSTILE, "#4276eb"]]
    assert "alert(1)" in found.text["samples"]
    assert "http" not in page.replace("http-equiv", "").replace("http://www.w3.org/2000/svg", "")


def test_data_in_a_page_read_back_as_they_were() -> None:
    data = {"<!--": [HOSTILE, "]]>", 1.5, None]}
    text = json_for_html(data)
    assert not set("<>&") & set(text)
    assert json.loads(text) == data
    with pytest.raises(ValueError, match="not JSON compliant"):
        json_for_html([float("nan")])


@given(text=st.text())
def test_no_text_ends_the_data_of_a_page(text: str) -> None:
    page = Page(f'<script type="application/json" id="samples">{json_for_html([text])}</script>')
    assert page.elements == ["script"]
    assert page.data == [text]


def decoded(url: str) -> ndarray:
    content = base64.b64decode(url.split(",", 1)[1])
    return np.asarray(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED))


def test_layers_are_transparent_where_they_do_not_hold(shards: Path) -> None:
    layers, expected = (
        read_page(preview_page("t", spread_samples(shards, 1))).data["samples"][0]["layers"],
        all_layers(),
    )
    assert list(layers) == list(LAYERS)
    for name, url in layers.items():
        assert url.startswith("data:image/png;base64,")
        picture = decoded(url)
        assert (picture[..., 3] == 255).sum() == layer_mask(name, expected).sum()
        shown = picture[..., 2::-1].astype(int) - layer_picture(name, expected)
        assert np.abs(shown).max() <= 8  # fixed point


def test_pictures_are_limited_and_landmarks_far_out_left_away(base: tuple[ShardHeader, Sample]) -> None:
    landmarks2d = base[1].landmarks2d.copy()
    landmarks2d[:3] = [[1e30, 0], [np.nan, 1], [5, 6]]
    image = encode_image(np.zeros((900, 1800, 3), np.uint8))
    layers = {"mask": np.ones((900, 1800), bool)}
    sample = replace(base[1], image_bytes=image, layers=layers, landmarks2d=landmarks2d)
    shown = read_page(preview_page("t", [(base[0], sample)])).data["samples"][0]
    assert (shown["width"], shown["height"]) == (1800, 900)  # what landmarks refer to
    assert decoded(shown["image"]).shape == (LARGEST_SIDE_PX // 2, LARGEST_SIDE_PX, 3)
    assert decoded(shown["layers"]["mask"]).shape == (LARGEST_SIDE_PX // 2, LARGEST_SIDE_PX, 4)
    assert shown["landmarks"][0] == [5, 6, True]
    assert len(shown["landmarks"]) == 66


def test_the_command_writes_a_page(shards: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "new" / "page.HTML"
    assert main(["preview", str(shards), "--out", str(out), "--n", "3"]) == 0
    assert len(read_page(out.read_text(encoding="utf-8")).data["samples"]) == 3
    assert f"-> {out}" in capsys.readouterr().err


def in_a_browser(page: str, folder: Path) -> str:
    """The page after its script has run; what the console says goes to an AssertionError."""
    file = folder / "page.html"
    file.write_text(page, encoding="utf-8")
    with opened_browser(folder, ["--disable-gpu"]) as browser:
        browser.show(file)
        assert browser.console == []
        return str(browser.evaluate("document.documentElement.outerHTML"))


def test_a_browser_shows_the_page_without_complaint(shards: Path, tmp_path: Path) -> None:
    dom = in_a_browser(preview_page(HOSTILE, spread_samples(shards, 4)), tmp_path)
    assert '<p id="name">one</p>' in dom
    assert '<span id="place">1 of 4</span>' in dom
    assert dom.count("<circle ") == 68
    assert dom.count("<option ") == len(LAYERS)
    assert dom.count("<script") == 2
    overlay = re.search(r'<img id="overlay"[^>]*>', dom)
    assert overlay is not None
    assert 'src="data:image/png' in overlay.group()
    assert "opacity: 0.6" in overlay.group()


def test_keys_turn_samples_and_layers(shards: Path, tmp_path: Path) -> None:
    """Left from the first sample is the last one, whose name would rather be markup."""
    page = preview_page("t", spread_samples(shards, 4))
    press = "".join(
        f"document.dispatchEvent(new KeyboardEvent('keydown', {{key: '{key}', cancelable: true}}));"
        for key in ("ArrowLeft", "ArrowUp", "x")
    )
    page = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", page)
    dom = in_a_browser(page.replace("</body>", f"<script>{press}document.title = 'pressed';</script></body>"), tmp_path)
    assert "<title>pressed</title>" in dom
    assert '<span id="place">4 of 4</span>' in dom
    assert '<p id="name">&lt;/script&gt;&lt;script&gt;alert(1)' in dom
    assert '<table id="regions">' in dom  # the last layer is that of the regions, whose names are listed
    assert dom.count("<script") == 3


def test_a_script_that_is_not_the_pages_own_does_not_run(shards: Path, tmp_path: Path) -> None:
    page = preview_page("t", spread_samples(shards, 1)).replace("</body>", "<script>document.title='x'</script></body>")
    with pytest.raises(AssertionError, match="Executing inline script violates"):
        in_a_browser(page, tmp_path)


def test_landmarks_under_a_cloth_mask_are_hidden(base: tuple[ShardHeader, Sample]) -> None:
    layers = all_layers()
    layers["seen"] = layers["mask"].copy()
    layers["seen"][30:] = False  # a mask over the lower half of the face
    landmarks2d = np.full((68, 2), 20.5, dtype=np.float32)
    landmarks2d[:, 1] = np.where(np.arange(68) < 40, 25.5, 35.5)
    picture = encode_image(np.full((60, 40, 3), 77, np.uint8))
    visible = np.arange(68) > 0  # the first one is hidden by the head
    sample = replace(base[1], image_bytes=picture, layers=layers, landmarks2d=landmarks2d, visible=visible)
    np.testing.assert_array_equal(landmarks_in_sight(sample), visible & (np.arange(68) < 40))
    title, legend, tile = sample_tiles(sample, LAYER_NAMES)[-1]
    assert (title, legend) == ("landmarks", "green: visible, red: hidden")
    assert tile[3 * 35 + 1, 3 * 20 + 1, 0] > 200 > tile[3 * 35 + 1, 3 * 20 + 1, 1]
    page = preview_page("masks", [(base[0], sample)])
    assert [own[2] for own in read_page(page).data["samples"][0]["landmarks"]] == landmarks_in_sight(sample).tolist()
    assert "landmarks (green: visible, red: hidden)" in page


def test_without_what_is_seen_the_legend_speaks_of_the_head(base: tuple[ShardHeader, Sample]) -> None:
    layers = {name: values for name, values in all_layers().items() if not name.startswith("seen")}
    picture = encode_image(np.full((60, 40, 3), 77, np.uint8))
    sample = replace(base[1], image_bytes=picture, layers=layers, landmarks2d=base[1].landmarks2d / 5)
    names = tuple(name for name in LAYER_NAMES if not name.startswith("seen"))
    assert sample_tiles(sample, names)[-1][1] == "red: hidden by the head"
    assert "landmarks (red: hidden by the head)" in preview_page("photographs", [(base[0], sample)])
    np.testing.assert_array_equal(landmarks_in_sight(sample), sample.visible)
