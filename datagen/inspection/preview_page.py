"""A page to go through samples and their layers: one HTML file that holds everything and needs no network.

Names come from files and are not trusted: the data are JSON without angle brackets, the script sets them as text, and
a content security policy lets only the page's own script run.
"""

import json
from collections.abc import Iterable, Mapping
from html import escape
from string import Template
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from datagen.inspection.layer_pictures import LEGENDS, layer_mask, layer_picture, layer_title, region_colour
from datagen.inspection.preview import landmark_legend, landmarks_in_sight, sample_picture, scaled
from datagen.inspection.statistics_tables import own_file
from pix2face.files.html_parts import data_url, policy_hash, script_data
from pix2face.files.images import encode_image, encode_photograph
from pix2face.shards.layers import LAYERS, SEEN_REGIONS
from pix2face.shards.sample import Sample
from pix2face.shards.shard_reader import ShardHeader

# Larger pictures are scaled down: 24 samples of a camera's size would make a page of hundreds of megabytes.
LARGEST_SIDE_PX = 720
# Landmarks further out than this are left out.
FAR_PX = 1e5
# Endings of attributes' names, and how they are shown behind the value.
_UNITS = {"mm": " mm", "px": " px", "deg": "°", "percent": " %", "years": " years", "ev": " EV"}


def preview_page(title: str, samples: Iterable[tuple[ShardHeader, Sample]]) -> str:
    """The page of some samples of one set, which are read one after the other.

    Raises:
        InputFileError: A picture cannot be decoded.
    """
    entries, layers, regions = [], dict[str, None](), list[tuple[str, str]]()
    for header, sample in samples:
        entries.append(_entry(sample))
        layers |= dict.fromkeys(name for name in LAYERS if name in sample.layers)
        regions = [(name, f"#{bytes(region_colour(i)).hex()}") for i, name in enumerate(header.region_names)]
    has_regions = not {"regions", SEEN_REGIONS}.isdisjoint(layers)
    titled = [[name, layer_title(name), LEGENDS[name]] for name in layers]
    return _page(title, {"samples": entries, "layers": titled, "regions": regions if has_regions else []})


def json_for_html(data: Any) -> str:
    """Data as JSON for a script element. NaN and infinity are refused."""
    return script_data(json.dumps(data, allow_nan=False))


def _page(title: str, data: Any) -> str:
    style, script = (own_file(name) for name in ("preview.css", "preview.js"))
    policy = f"default-src 'none'; img-src data:; style-src '{policy_hash(style)}'; script-src '{policy_hash(script)}'"
    texts = {"title": escape(title), "policy": policy, "style": style, "script": script, "data": json_for_html(data)}
    texts["landmarks"] = landmark_legend([name for name, *_ in data["layers"]])
    return Template(own_file("preview.html")).substitute(texts)


def _entry(sample: Sample) -> dict[str, Any]:
    """The data of a sample for the script."""
    picture = sample_picture(sample)
    height, width = picture.shape[:2]
    landmarks = [
        [round(float(x), 2), round(float(y), 2), bool(visible)]
        for (x, y), visible in zip(sample.landmarks2d, landmarks_in_sight(sample), strict=True)
        if abs(x) < FAR_PX and abs(y) < FAR_PX
    ]
    return {
        "id": sample.sample_id,
        "width": width,
        "height": height,
        "image": None if sample.image_bytes is None else _picture_url(sample.image_bytes, picture),
        "layers": {name: _layer_url(name, sample.layers) for name in LAYERS if name in sample.layers},
        "landmarks": landmarks,
        "attributes": _attribute_groups(sample.attributes),
    }


def _attribute_groups(attributes: Mapping[str, str | float]) -> list[tuple[str, list[tuple[str, str, str]]]]:
    """Attributes in words: for each part (skin, hair, ...) the label, value and full name of each."""
    groups: dict[str, list[tuple[str, str, str]]] = {"": []}
    for name, value in sorted(attributes.items()):
        part, _, own = name.rpartition(".")
        stem, _, ending = own.rpartition("_")
        unit = _UNITS.get(ending, "") if stem else ""
        shown = f"{value:.4g}" if isinstance(value, float) else str(value) or "-"
        label = (stem if unit else own).replace("_", " ")
        groups.setdefault(part.replace(".", ", ").replace("_", " "), []).append((label, f"{shown}{unit}", name))
    return list(groups.items())


def _picture_url(content: bytes, picture: UInt8[ndarray, "h w 3"]) -> str:
    """A picture as a PNG file's own bytes, or encoded as JPEG."""
    if max(picture.shape[:2]) <= LARGEST_SIDE_PX and content.startswith(b"\x89PNG"):
        return data_url("png", content)
    # JPEG files are encoded again too: a browser would turn them by their orientation tag, but not the maps.
    return data_url("jpeg", encode_photograph(scaled(picture, min(LARGEST_SIDE_PX, max(picture.shape[:2]))), 92))


def _layer_url(name: str, layers: Mapping[str, ndarray]) -> str:
    """A layer, transparent where it has no value."""
    alpha = layer_mask(name, layers)[..., None] * np.uint8(255)
    rgba = np.concatenate([layer_picture(name, layers), alpha], axis=2)
    return data_url("png", encode_image(scaled(rgba, min(LARGEST_SIDE_PX, max(alpha.shape)), cv2.INTER_NEAREST)))
