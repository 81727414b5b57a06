"""Grammars of what is read as text: annotations, lists of faces, boxes, predictions, JSON, TOML, meshes."""

from pathlib import Path
from typing import Any

import numpy as np

from datagen.appearance.appearance_config import PLAIN, PRESETS, load_configuration, to_toml
from pix2face.commands.view_cli import _stored_points
from pix2face.evaluation.report.compare import read_report
from pix2face.evaluation.subjects.predictions_file import read_predictions
from pix2face.face_files.annotations import read_dlib_xml
from pix2face.face_files.box_files import read_box_file
from pix2face.geometry.camera import Camera
from pix2face.geometry.landmarks import read_pts
from pix2face.landmark_choice.landmark_file import load_landmarks
from pix2face.model_formats import read_model
from pix2face.models.morphable_model import builtin_model
from pix2face.photographs.fit_files import read_fit
from tests.fuzz.grammar import Grammar
from tests.fuzz.values import LENGTHS, NUMBERS, TEXTS, Rng, mutated, one, several, written

PLAIN_LINES = to_toml(PRESETS[PLAIN]).splitlines()
WORDS = (*map(str, NUMBERS), *TEXTS, "1e3", "-1", "1_0", "٣", "1,5", "0x1p3")


def number(rng: Rng) -> str:
    return f"{rng.uniform(0, 300):.3f}" if rng.random() < 0.995 else one(rng, WORDS)


def pts(path: Path, rng: Rng) -> None:
    n = 68 if rng.random() < 0.7 else int(one(rng, (0, 1, 67, 69, 2000)))
    body = "\n".join(f"{number(rng)} {number(rng)}" for _ in range(n))
    brace, end = (one(rng, ("{", "{", "{", "", "{{")), one(rng, ("}", "}", "}", "", "}}")))
    declared = n if rng.random() < 0.7 else one(rng, WORDS)
    text = f"version: {one(rng, ('1', '1', *WORDS))}\nn_points: {declared}\n{brace}\n{body}\n{end}\n"
    path.write_bytes(text.encode(one(rng, ("utf-8", "utf-8", "utf-16")), "replace"))


def xml(path: Path, rng: Rng) -> None:
    def quoted(text: str) -> str:
        return "'" + text.translate({0: None, 27: None, 39: "&#39;", 38: "&amp;", 60: "&lt;"}) + "'"

    def part(index: int) -> str:
        name = f"{index:02}" if rng.random() < 0.98 else one(rng, WORDS)
        return f"<part name={quoted(name)} x={quoted(number(rng))} y={quoted(number(rng))}/>"

    def box() -> str:
        inner = "".join(part(index) for index in range(int(one(rng, (0, 5, 68, 68, 68, 70)))))
        if rng.random() < 0.1:
            inner = one(
                rng,
                ("<box>" * 500 + "</box>" * 500, "<image file='b'>" + inner + "</image>", "<part/>", "<![CDATA[x]]>"),
            )
        return f"<box ignore='{one(rng, (0, 0, 0, 1, 'x'))}'>{inner}</box>"

    images = "".join(
        f"<image {one(rng, ('file', 'file', 'file', 'name'))}={quoted(one(rng, ('a.jpg', *TEXTS)))}>"
        + box() * int(one(rng, (0, 1, 1, 2, 30)))
        + "</image>"
        for _ in range(int(rng.integers(4)))
    )
    encoding = one(
        rng,
        (
            "",
            "",
            "",
            *(f" encoding='{name}'" for name in ("utf-8", "latin-1", "rot13", "utf-16", "utf-7", "bz2", "cp037")),
        ),
    )
    doctype = one(rng, ("", "", "", "<!DOCTYPE a [<!ENTITY b 'c'>]>", "<!DOCTYPE a SYSTEM '/etc/passwd'>"))
    root = one(rng, ("dataset",) * 6 + ("data", "x:dataset"))
    path.write_text(
        f"<?xml version='1.0'{encoding}?>{doctype}<{root}><images>{images}</images></{root}>", "utf-8", "replace"
    )


def csv_rows(rng: Rng, heading: list[str]) -> str:
    heading = several(rng, lambda words: words + [one(rng, WORDS)], heading) if rng.random() < 0.1 else heading
    lines = [heading] + [
        [one(rng, ("a.jpg", "b", *TEXTS)), *(number(rng) for _ in heading[1:])]
        for _ in range(int(one(rng, (0, 1, 3, 20))))
    ]
    if rng.random() < 0.3 and len(lines) > 1:
        lines[-1] = one(
            rng, (lines[-1][:-1], lines[-1] * 2, ['"' + "x" * 200_000], ["x" * 2_000_000], ['"a\nb"', *lines[-1][1:]])
        )
    return "\n".join(",".join(line) for line in lines)


def predictions_csv(path: Path, rng: Rng) -> None:
    axes = one(rng, ("xy", "xy", "xyz", "x"))
    text = csv_rows(rng, ["name", *(f"{axis}{index}" for index in range(68) for axis in axes)])
    path.write_text(text, "utf-8", "replace")


def boxes_csv(path: Path, rng: Rng) -> None:
    heading = [one(rng, ("image", "frame", "name")), "left", "top", "right", "bottom"]
    path.write_text(csv_rows(rng, heading), "utf-8", "replace")


def json_of(value: Any) -> Any:
    """A grammar of JSON around what is right."""

    def write(path: Path, rng: Rng) -> None:
        path.write_text(written(several(rng, lambda one: mutated(one, rng), value)), "utf-8", "replace")

    return write


def toml(path: Path, rng: Rng) -> None:
    lines = list(PLAIN_LINES)
    for _ in range(int(rng.integers(1, 5))):
        place = int(rng.integers(len(lines)))
        name = lines[place].partition("=")[0] or "x "
        pieces = (
            *NUMBERS,
            "nan",
            "inf",
            "-inf",
            "true",
            '"a"',
            "[]",
            "[1, 2]",
            "[" * 2000 + "]" * 2000,
            "{a = 1}",
            "1979-05-27",
            "9" * 5000,
        )
        lines[place] = one(
            rng, (f"{name}= {one(rng, pieces)}", f"{name}= {one(rng, pieces)}", "[a]", lines[place] * 2, "a.b.c" * 99)
        )
    path.write_text("\n".join(lines), "utf-8", "replace")


def obj(path: Path, rng: Rng) -> None:
    folder = path.with_suffix("") / "FaceXModel"
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("generic_neutral_mesh", "identity000", "smile"):
        lines = [f"v {number(rng)} {number(rng)} {number(rng)}" for _ in range(int(one(rng, (5, 5, 5, 5, 0, 6))))]
        lines += [f"vt {number(rng)} {number(rng)}" for _ in range(int(one(rng, (0, 5))))]
        lines += [f"f {' '.join(face_corner(rng) for _ in range(int(one(rng, (3, 3, 4, 4, 2, 9)))))}" for _ in range(4)]
        lines += [one(rng, ("", "usemtl M_Face", "f", "v", "v 1 2", "# x", "\0", "f 1//1 2//1 3//1"))]
        (folder / f"{name}.obj").write_text("\n".join(lines), "utf-8", "replace")


def face_corner(rng: Rng) -> str:
    return str(rng.integers(1, 6)) if rng.random() < 0.97 else one(rng, ("1/1", "0", "-1", "9", *WORDS))


def ply(path: Path, rng: Rng) -> None:
    kinds = ("float", "float", "double", "uchar", "int", "x", "list uchar int")
    properties = "".join(f"property {one(rng, kinds)} {name}\n" for name in one(rng, ("xyz", "xy", "x" * 50)))
    colours = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    count = int(one(rng, LENGTHS)) if rng.random() < 0.4 else 3
    head = f"ply\nformat {one(rng, ('binary_little_endian', 'ascii', 'binary_big_endian', 'x'))} 1.0\n"
    path.write_bytes(f"{head}element vertex {count}\n{properties}{colours}end_header\n".encode() + rng.bytes(45))


def fit_of_builtin() -> dict[str, Any]:
    model = builtin_model()
    return {
        "photograph": "a.jpg",
        "model": {"name": model.name, "sha256": model.sha256},
        "camera_matrix": Camera(np.eye(4)).matrix.tolist(),
        "identity": [0.0] * model.n_identity,
        "expression": [0.0] * model.n_expression,
        "landmarks2d_px": [[0.0, 0.0]] * 68,
        "landmarks3d_mm": [[0.0, 0.0, 0.0]] * 68,
    }


REPORT = {
    "format": "pix2face-evaluation",
    "schema_version": 2,
    "method": "network",
    "subject": {"landmarks": "x"},
    "benchmark": {"split": "a", "truth": "b", "normaliser": "c", "threshold": 0.08, "box_rule": "d", "title": "e"},
    "faces": [{"name": "a", "clip": None, "errors": {"68": 0.1, "51": None}}],
}
CHOSEN = {
    "format": "pix2face-landmarks",
    "schema_version": 1,
    "scheme": "ibug68",
    "vertices": list(range(68)),
    "model": {"name": "a", "sha256": "b"},
}
TEXT_GRAMMARS = {
    "pts": Grammar(pts, read_pts, ".pts"),
    "xml": Grammar(xml, read_dlib_xml, ".xml"),
    "predictions csv": Grammar(predictions_csv, lambda path: read_predictions(path, "0-based"), ".csv"),
    "boxes csv": Grammar(boxes_csv, read_box_file, ".csv"),
    "boxes json": Grammar(json_of({"a.jpg": [[1, 2, 3, 4], [5, 6, 70, 80]], "b": []}), read_box_file, ".json"),
    "fit": Grammar(json_of(fit_of_builtin()), lambda path: read_fit(path, builtin_model()), ".json"),
    "landmarks": Grammar(json_of(CHOSEN), load_landmarks, ".json"),
    "report": Grammar(json_of(REPORT), read_report, ".json"),
    "configuration": Grammar(toml, lambda path: load_configuration(str(path)), ".toml"),
    "obj": Grammar(obj, lambda path: read_model(path.with_suffix("")), ".obj"),
    "ply": Grammar(ply, _stored_points, ".ply"),
}
