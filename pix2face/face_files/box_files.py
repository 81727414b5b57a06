"""Reads boxes of faces that another detector or a person has found (layout: docs/reference).

A CSV file has a header and one face per line: ``image,left,top,right,bottom`` (other columns are ignored). A JSON file
is an object with a list of ``[left, top, right, bottom]`` for each image. An image is identified by its path or by its
file name alone, and a frame of a video by its number, counted from 0. Boxes are tight around the 68 landmarks, in
pixels of the upright picture (orientation tag applied), with pixel centres at +0.5.
"""

import csv
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from pix2face.errors import InputFileError
from pix2face.files.json_text import read_json_file
from pix2face.files.opening import text_lines
from pix2face.geometry.crops import FaceBox

COLUMNS = ("left", "top", "right", "bottom")
NAME_COLUMNS = ("image", "frame")
LARGEST_BOX_PX = 1e6
# A million faces.
LARGEST_FILE_BYTES = 64 << 20


@final
@dataclass(frozen=True)
class BoxFile:
    """Face boxes by the name of their picture."""

    path: Path  #: the file, for messages
    boxes: Mapping[str, tuple[FaceBox, ...]]  #: for each name its boxes, largest first

    def of_image(self, path: Path) -> tuple[FaceBox, ...]:
        """The boxes of a picture, largest first; empty if the file has none."""
        names = (str(path), path.as_posix(), path.name)
        return next((self.boxes[name] for name in names if name in self.boxes), ())

    def of_frame(self, frame: int) -> tuple[FaceBox, ...]:
        """The boxes of a frame of a video, counted from 0, largest first; empty if the file has none."""
        return self.boxes.get(str(frame), ())


def read_box_file(path: Path) -> BoxFile:
    """Reads a CSV or JSON file of face boxes.

    Raises:
        InputFileError: It is missing or of another format, or it contains a box without extent or with impossible
            coordinates.
    """
    rows = _json_rows(path) if path.suffix.lower() == ".json" else _csv_rows(path)
    boxes: dict[str, list[FaceBox]] = {}
    for where, name, sides in rows:
        boxes.setdefault(name, []).append(_box(path, where, sides))
    if not boxes:
        raise InputFileError(f"{path}: expected at least one face box, found none")
    ordered = {name: tuple(sorted(own, key=lambda box: -box.longer_side)) for name, own in boxes.items()}
    return BoxFile(path, ordered)


def _csv_rows(path: Path) -> Iterator[tuple[str, str, Iterable[Any]]]:
    reader = csv.DictReader(text_lines(path, "a CSV file of face boxes", LARGEST_FILE_BYTES))
    columns = [name.strip() for name in reader.fieldnames or ()]
    reader.fieldnames = columns
    name_column = next((name for name in NAME_COLUMNS if name in columns), None)
    if name_column is None or not set(COLUMNS) <= set(columns):
        raise InputFileError(
            f"{path}: expected a first line with the columns image (or frame), {', '.join(COLUMNS)}, "
            f"found {','.join(columns)[:80]!r}"
        )
    try:
        for row in reader:
            yield f"line {reader.line_num}", str(row[name_column] or "").strip(), [row[side] for side in COLUMNS]
    except csv.Error as error:
        raise InputFileError(f"{path}: expected CSV, found at line {reader.line_num}: {error}") from error


def _json_rows(path: Path) -> Iterator[tuple[str, str, Iterable[Any]]]:
    expected = "a JSON object with a list of [left, top, right, bottom] for each image"
    boxes_of = read_json_file(path, dict[str, list[tuple[float, float, float, float]]], expected, LARGEST_FILE_BYTES)
    for name, boxes in boxes_of.items():
        for box in boxes:
            yield repr(name), name, box


def _box(path: Path, where: str, sides: Iterable[Any]) -> FaceBox:
    found = list(sides)
    try:
        left, top, right, bottom = (float(side) for side in found)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputFileError(f"{path}, {where}: expected four numbers, found {found!r}") from error
    if not (np.abs([left, top, right, bottom]).max() <= LARGEST_BOX_PX and right - left >= 1 and bottom - top >= 1):
        raise InputFileError(
            f"{path}, {where}: expected left < right and top < bottom by a pixel or more, at most a million pixels, "
            f"found {found!r}"
        )
    return FaceBox(left, top, right, bottom)
