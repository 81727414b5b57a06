"""HTML files that show fitted faces over their photographs and turn them; they need no other file and no network.

The viewer in it is three.js with ``scripts/viewer/viewer.js`` (ASSETS.md says how it is built).
"""

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any, final
from urllib.parse import quote

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from pix2face.command_line import printable
from pix2face.files.html_parts import base64_text, data_url, policy_hash, script_data
from pix2face.files.images import encode_photograph
from pix2face.files.opening import is_regular
from pix2face.files.writing import write_file
from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.camera import head_pose, nearest_weak_perspective
from pix2face.geometry.crops import FaceBox, crop_camera, crop_image, square_crop
from pix2face.models.surface_attributes import split_at_seams, vertex_normals
from pix2face.photographs.mesh_files import linear_colours
from pix2face.photographs.texture import face_texture, vertex_colours

# A face of the built-in model takes 2 MB, so a page opens in a moment.
FACES_A_PAGE = 10
PHOTOGRAPH_PX, PHOTOGRAPH_SCALE = 640, 2.0
JPEG_QUALITY = 90


@final
@dataclass(frozen=True, eq=False)
class ViewedFace:
    """A fitted face for the page."""

    name: str  # may hold any characters
    image: UInt8[ndarray, "h w 3"]  # the photograph, RGB
    fit: FaceFit  # in the pixels of the photograph
    points: Float32[ndarray, "n 3"]  # point cloud, mm, model frame; may be empty
    point_colours: UInt8[ndarray, "n 3"]  # RGB


def face_data(face: ViewedFace) -> str:
    """What the page needs of one face, some megabytes of JSON.

    Raises:
        DegenerateGeometryError: The face has no extent in the photograph.
    """
    crop = square_crop(FaceBox.around(face.fit.landmarks2d), PHOTOGRAPH_SCALE, PHOTOGRAPH_PX)
    pose, camera = head_pose(face.fit.camera), nearest_weak_perspective(crop_camera(face.fit.camera, crop))
    score = "" if face.fit.score is None else f", score {face.fit.score:.2f}"
    fields = {
        "name": printable(face.name),
        "facts": f"pitch {pose.pitch_deg:.0f}°, yaw {pose.yaw_deg:.0f}°, roll {pose.roll_deg:.0f}°{score}",
        "photograph": _data_address(crop_image(face.image, crop)),
        "photograph_px": PHOTOGRAPH_PX,
        "landmarks2d": np.round(crop.to_crop(face.fit.landmarks2d), 2).tolist(),
        "landmarks3d": _base64(face.fit.landmarks3d, "<f4"),
        "rotation": camera.rotation.ravel().tolist(),
        "px_per_mm": camera.scale,
        "translation_px": camera.translation_px.tolist(),
        "points": _base64(face.points, "<f4"),
        "point_colours": _base64(linear_colours(face.point_colours), "u1"),
        **_mesh_fields(face),
    }
    return json.dumps(fields)


@final
class ViewPages:
    """Writes faces to pages of at most ``FACES_A_PAGE``: NAME.html, NAME-2.html and so on, each with links to the next.

    Only the faces of one page are in memory. Pages of an earlier and longer run are removed at the end.
    """

    def __init__(self, path: Path, title: str) -> None:
        self._path, self._title = path, title
        self._faces: list[str] = []
        self.paths: list[Path] = []

    def add(self, face: str) -> None:
        """Adds a face (of ``face_data``)."""
        if len(self._faces) == FACES_A_PAGE:
            self._write(is_last=False)
        self._faces.append(face)

    def close(self) -> None:
        """Writes the last page, if there is any face."""
        if not self._faces:
            return
        self._write(is_last=True)
        number = len(self.paths) + 1
        while _is_view_page(self._place(number)):
            self._place(number).unlink()
            number += 1

    def _write(self, *, is_last: bool) -> None:
        number = len(self.paths) + 1
        links = [(number - 1, "previous")] if number > 1 else []
        links += [] if is_last else [(number + 1, "next")]
        ways = " ".join(f'<a href="{quote(os.fsencode(self._place(to).name))}">{word}</a>' for to, word in links)
        navigation = f"<nav>Page {number} {ways}</nav>" if ways else ""
        page = view_page(self._faces, self._title, navigation)
        write_file(self._place(number), page.encode("utf-8", errors="backslashreplace"))
        self.paths.append(self._place(number))
        self._faces = []

    def _place(self, number: int) -> Path:
        return self._path if number == 1 else self._path.with_stem(f"{self._path.stem}-{number}")


def _is_view_page(path: Path) -> bool:
    """Whether a file is a page that we wrote."""
    if not is_regular(path):
        return False
    with path.open("rb") as file:
        return file.read(len(_MARK)) == _MARK.encode()


def view_page(faces: Sequence[str], title: str, navigation: str = "") -> str:
    """The page of some faces (of ``face_data``); whatever their names are, they are shown and never obeyed.

    ``navigation`` is HTML for its head.
    """
    script = _viewer()
    data = "[" + script_data(",\n".join(faces)) + "]"
    policy = f"default-src 'none'; script-src '{policy_hash(script)}'; style-src 'unsafe-inline'; img-src data:"
    shown = {"title": escape(printable(title)), "policy": policy, "style": _STYLE, "navigation": navigation}
    return _MARK + _PAGE.format(data=data, script=script, **shown)


def _mesh_fields(face: ViewedFace) -> dict[str, Any]:
    fit, model = face.fit, face.fit.model
    normals = vertex_normals(fit.vertices, model.triangles)
    if model.uv is None:
        return {
            "positions": _base64(fit.vertices, "<f4"),
            "normals": _base64(normals, "<f4"),
            "triangles": _base64(model.triangles, "<u4"),
            "colours": _base64(linear_colours(vertex_colours(face.image, fit, model)), "u1"),
        }
    vertex, uv, triangles = split_at_seams(model)
    return {
        "positions": _base64(fit.vertices[vertex], "<f4"),
        "normals": _base64(normals[vertex], "<f4"),
        "triangles": _base64(triangles, "<u4"),
        "uv": _base64(uv, "<f4"),
        "texture": _data_address(face_texture(face.image, fit, model)),
    }


def _base64(values: ndarray, dtype: str) -> str:
    return base64_text(np.ascontiguousarray(values, dtype=dtype).tobytes())


def _data_address(picture: UInt8[ndarray, "h w 3"]) -> str:
    return data_url("jpeg", encode_photograph(picture, JPEG_QUALITY))


@cache
def _viewer() -> str:
    script = (files("pix2face") / "assets" / "viewer" / "viewer.js").read_text(encoding="ascii")
    assert "</script" not in script.lower()
    return script


_STYLE = """
* { box-sizing: border-box; }
body { margin: 0; height: 100vh; display: flex; flex-direction: column; font: 15px/1.4 sans-serif;
       background: #20242a; color: #e8e8e8; }
header { display: flex; flex-wrap: wrap; gap: .4em 1.4em; align-items: center; padding: .6em 1em;
         background: #2b3038; }
fieldset { display: flex; flex-wrap: wrap; gap: .2em 1em; margin: 0; padding: 0; border: 0; }
main { flex: 1; min-height: 0; display: flex; flex-wrap: wrap; }
figure { margin: 0; flex: 1 1 20em; min-width: 0; height: 100%; container-type: size; display: grid;
         place-items: center; }
.square { position: relative; width: min(100cqw, 100cqh); aspect-ratio: 1; overflow: hidden; }
.square > * { position: absolute; inset: 0; width: 100%; height: 100%; }
#landmarks2d circle { fill: #3cff3c; }
#stage { cursor: grab; }
#stage:active { cursor: grabbing; }
#behind { transition: opacity .3s; }
[data-view=turned] #behind { opacity: .12; }
#hint { inset: auto 0 .6em; width: auto; height: auto; margin: 0; text-align: center; pointer-events: none; }
#hint span { padding: .2em .8em; border-radius: 1em; background: #20242acc; }
[data-view=turned] #hint { display: none; }
#problem { padding: 1em; background: #7a2020; }
#facts { color: #b8c0c8; }
nav a { color: inherit; }
@media (max-width: 45em) { figure { height: 50%; flex-basis: 100%; } }
"""

# How our pages begin, by which those of an earlier run are known.
_MARK = "<!doctype html><!-- pix2face view -->\n"
_PAGE = """<html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>{style}</style></head>
<body data-state="loading">
<header>{navigation}
<label>Face <select id="face"></select></label>
<fieldset id="toggles">
<label><input type="checkbox" id="show-mesh" checked> mesh</label>
<label><input type="checkbox" id="show-points"> points</label>
<label><input type="checkbox" id="show-texture" checked> texture</label>
<label><input type="checkbox" id="show-wireframe"> wireframe</label>
<label><input type="checkbox" id="show-landmarks"> landmarks</label>
</fieldset>
<button id="reset" type="button">View of the photograph</button>
<span id="facts"></span>
</header>
<p id="problem" hidden></p>
<main>
<figure><div class="square"><img id="photograph" alt="">
<svg id="landmarks2d" xmlns="http://www.w3.org/2000/svg"></svg></div></figure>
<figure><div class="square"><img id="behind" alt=""><div id="stage"></div>
<p id="hint"><span>Drag to turn the face, scroll to zoom</span></p></div></figure>
</main>
<script type="application/json" id="faces">{data}</script>
<script>{script}</script>
</body></html>
"""
