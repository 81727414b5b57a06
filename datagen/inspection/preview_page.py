"""A page to go through samples and their layers: one HTML file that holds everything and asks the network for nothing.

Names in it come from files, so none is trusted: data travel as JSON without angle brackets, the script sets them as
text, and a content security policy lets no script run but the page's own.
"""

import base64
import hashlib
import json
from collections.abc import Iterable, Mapping
from html import escape
from importlib.resources import files
from typing import Any

import cv2
import numpy as np
from jaxtyping import Shaped, UInt8
from numpy import ndarray

from datagen.inspection.layer_pictures import layer_mask, layer_picture, region_colour
from datagen.inspection.preview import sample_picture
from pix2face.files.images import encode_image, encode_photograph
from pix2face.shards.layers import LAYERS, SEEN_REGIONS
from pix2face.shards.shard_reader import ShardHeader, Triplet

# Larger pictures are scaled down: nobody looks at 24 samples of a camera's size, and no browser likes to.
LARGEST_SIDE_PX = 720
# A landmark further out than this is drawn nowhere.
FAR_PX = 1e5


def preview_page(title: str, samples: Iterable[tuple[ShardHeader, Triplet]]) -> str:
    """Writes the page.

    Args:
        title: Shown above the samples.
        samples: Of one set of shards; read one after the other.

    Raises:
        InputFileError: A picture cannot be decoded.
    """
    entries, layers, regions = [], dict[str, None](), list[tuple[str, str]]()
    for header, triplet in samples:
        entries.append(_entry(triplet))
        layers |= dict.fromkeys(name for name in LAYERS if name in triplet.layers)
        regions = [(name, _css_colour(i)) for i, name in enumerate(header.region_names)]
    has_regions = not {"regions", SEEN_REGIONS}.isdisjoint(layers)
    return _page(title, {"samples": entries, "layers": list(layers), "regions": regions if has_regions else []})


def json_for_html(data: Any) -> str:
    """JSON that can stand inside a script element: no character of it can end the element or start another."""
    text = json.dumps(data, allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _page(title: str, data: Any) -> str:
    style, script = (_own_file(name) for name in ("preview.css", "preview.js"))
    policy = f"default-src 'none'; img-src data:; style-src '{_hash(style)}'; script-src '{_hash(script)}'"
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(title)}</title><link rel="icon" href="data:,">
<style>{style}</style></head><body>
<h1>{escape(title)}</h1>
<div id="controls">
<span><button id="previous" type="button">&larr;</button> <span id="place"></span>
<button id="next" type="button">&rarr;</button></span>
<label>layer <select id="layer"></select></label>
<label>over the picture <input id="opacity" type="range" min="0" max="100" value="60"></label>
<label><input id="dots" type="checkbox" checked> landmarks (green: visible, red: hidden)</label>
<span>keys: &larr; &rarr; samples, &uarr; &darr; layers</span>
</div>
<div id="view"><div id="stage"><img id="picture" alt="picture"><img id="overlay" alt="layer">
<svg id="landmarks"></svg></div>
<div id="about"><p id="name"></p><table id="attributes"></table><table id="regions" hidden></table></div></div>
<script type="application/json" id="samples">{json_for_html(data)}</script>
<script>{script}</script>
</body></html>
"""


def _entry(triplet: Triplet) -> dict[str, Any]:
    """What the script knows of a sample."""
    picture = sample_picture(triplet)
    height, width = picture.shape[:2]
    landmarks = [
        [round(float(x), 2), round(float(y), 2), bool(visible)]
        for (x, y), visible in zip(triplet.landmarks2d, triplet.visible, strict=True)
        if abs(x) < FAR_PX and abs(y) < FAR_PX
    ]
    return {
        "id": triplet.sample_id,
        "width": width,
        "height": height,
        "image": None if triplet.image is None else _picture_url(triplet.image, picture),
        "layers": {name: _layer_url(name, triplet.layers) for name in LAYERS if name in triplet.layers},
        "landmarks": landmarks,
        "attributes": [[str(name), _shown(value)] for name, value in sorted(triplet.attributes.items())],
    }


def _shown(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _picture_url(content: bytes, picture: UInt8[ndarray, "h w 3"]) -> str:
    """A photograph by its own bytes where a browser shows them as they are; else as a JPEG."""
    if max(picture.shape[:2]) <= LARGEST_SIDE_PX and content.startswith(b"\x89PNG"):
        return _url("png", content)
    # JPEG files are encoded anew as well: a browser would turn them by their orientation tag, the maps would not turn.
    return _url("jpeg", encode_photograph(_limited(picture), 92))


def _layer_url(name: str, layers: Mapping[str, ndarray]) -> str:
    """A layer, transparent where it does not hold."""
    alpha = layer_mask(name, layers)[..., None] * np.uint8(255)
    return _url("png", encode_image(_limited(np.concatenate([layer_picture(name, layers), alpha], axis=2))))


def _limited(picture: Shaped[ndarray, "h w c"]) -> Shaped[ndarray, "h2 w2 c"]:
    scale = LARGEST_SIDE_PX / max(picture.shape[:2])
    if scale >= 1:
        return picture
    size = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA if picture.shape[2] == 3 else cv2.INTER_NEAREST)


def _url(kind: str, content: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def _css_colour(index: int) -> str:
    return "#" + "".join(f"{channel:02x}" for channel in region_colour(index))


def _own_file(name: str) -> str:
    return (files("datagen.inspection") / "pages" / name).read_text(encoding="utf-8")


def _hash(content: str) -> str:
    return f"sha256-{base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()}"
