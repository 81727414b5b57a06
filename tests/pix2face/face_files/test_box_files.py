"""Boxes from files: what is read, and what is refused in which words."""

import json
from pathlib import Path

import pytest

from pix2face.errors import InputFileError
from pix2face.face_files.box_files import read_box_file
from pix2face.geometry.crops import FaceBox


def written(tmp_path: Path, text: str, name: str = "boxes.csv") -> Path:
    path = tmp_path / name
    path.write_text(text)
    return path


def test_csv_by_path_and_by_file_name(tmp_path):
    boxes = read_box_file(
        written(
            tmp_path, "image,left,top,right,bottom,score\na/b.jpg,1,2,3.5,4,9\nc.png,0,0,10,10,1\nc.png,0,0,20,5,1\n"
        )
    )
    assert boxes.of_image(Path("a/b.jpg")) == (FaceBox(1, 2, 3.5, 4),)
    assert boxes.of_image(Path("b.jpg")) == ()
    assert boxes.of_image(Path("somewhere/c.png")) == (FaceBox(0, 0, 20, 5), FaceBox(0, 0, 10, 10))


def test_frames_by_number(tmp_path):
    boxes = read_box_file(written(tmp_path, "\ufeffframe, left, top, right, bottom\n7,1,2,30,40\n"))
    assert boxes.of_frame(7) == (FaceBox(1, 2, 30, 40),)
    assert boxes.of_frame(8) == ()
    assert boxes.of_image(Path("frames/7.png")) == ()  # a frame's number is no file name


def test_json_says_the_same_as_csv(tmp_path):
    by_json = read_box_file(written(tmp_path, json.dumps({"b.jpg": [[1, 2, 3, 4], [0, 0, 9, 9]]}), "boxes.json"))
    by_csv = read_box_file(written(tmp_path, "image,left,top,right,bottom\nb.jpg,1,2,3,4\nb.jpg,0,0,9,9\n"))
    assert by_json.boxes == by_csv.boxes


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("b.csv", "", "columns image"),
        ("b.csv", "image,left,top,right\na,1,2,3\n", "columns image"),
        ("b.csv", "image,left,top,right,bottom\n", "at least one face box"),
        ("b.csv", "image,left,top,right,bottom\na,1,2,x,4\n", "line 2: expected four numbers"),
        ("b.csv", "image,left,top,right,bottom\na,1,2\n", "line 2: expected four numbers"),
        ("b.csv", "image,left,top,right,bottom\na,5,2,1,4\n", "left < right"),
        ("b.csv", "image,left,top,right,bottom\na,nan,2,9,4\n", "left < right"),
        ("b.csv", "image,left,top,right,bottom\na,0,0,1e9,9\n", "left < right"),
        ("b.json", "{", "expected a JSON object"),
        ("b.json", "[]", "Expected `object`, got `array`"),
        ("b.json", '{"a": [1, 2, 3, 4]}', "a list of"),
        ("b.json", '{"a": [[1, 2, 3]]}', "of length 4"),
        ("b.json", f'{{"a": [[1, 2, 3, 1{"0" * 400}]]}}', "out of range"),
    ],
)
def test_other_files_are_refused(tmp_path, name, text, words):
    with pytest.raises(InputFileError, match=words):
        read_box_file(written(tmp_path, text, name))
