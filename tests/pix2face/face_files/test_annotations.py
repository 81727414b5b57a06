"""Folders of annotated photographs: what is found, where pixels are counted from, what is refused."""

import contextlib
from pathlib import Path
from time import process_time

import cv2
import numpy as np
import pytest
import scipy.io
from numpy import ndarray

from pix2face.errors import InputFileError, UsageError
from pix2face.face_files.annotations import AnnotatedFace, find_annotations, read_dlib_xml

POINTS = np.arange(136.0).reshape(68, 2)


def write_pts(path: Path, points: ndarray = POINTS) -> None:
    lines = "\n".join(f"{x} {y}" for x, y in points)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"version: 1\nn_points: 68\n{{\n{lines}\n}}\n")


def write_picture(path: Path, height_px: int = 140, width_px: int = 140) -> None:
    assert cv2.imwrite(str(path), np.zeros((height_px, width_px, 3), np.uint8))


def box(points: ndarray = POINTS, attributes: str = "") -> str:
    parts = "".join(f"<part name='{i:02}' x='{x:g}' y='{y:g}'/>" for i, (x, y) in enumerate(points))
    return f"<box top='0' left='0' width='9' height='9' {attributes}>{parts}</box>"


def write_xml(path: Path, images: dict[str, str], prologue: str = "") -> None:
    body = "".join(f"<image file='{name}'>{boxes}</image>" for name, boxes in images.items())
    path.write_text(f"<?xml version='1.0'?>{prologue}<dataset><images>{body}</images></dataset>")


def load_all(folder: Path) -> dict[str, AnnotatedFace | str]:
    faces: dict[str, AnnotatedFace | str] = {}
    for annotation in find_annotations(folder):
        try:
            faces[annotation.name] = annotation.load()
        except InputFileError as error:
            faces[annotation.name] = str(error)
    return faces


def test_each_format_is_brought_to_the_projects_pixels(tmp_path: Path) -> None:
    write_pts(tmp_path / "a" / "face.pts")
    mat = {
        "Shape_Para": np.zeros(199),
        "Exp_Para": np.zeros(29),
        "Pose_Para": np.array([[0, 0, 0, 68, 85, 1, 0.001]]),
        "pt3d_68": np.vstack([POINTS.T, np.arange(68.0)]),
    }
    scipy.io.savemat(tmp_path / "a" / "posed.mat", mat)
    write_xml(tmp_path / "list.xml", {"a/face.jpg": box() + box(POINTS + 1)})
    for name in ("face.jpg", "posed.jpg"):
        write_picture(tmp_path / "a" / name)
    faces = load_all(tmp_path)
    assert list(faces) == ["a/face", "a/face/face0", "a/face/face1", "a/posed"]
    for name, first in {"a/face": -0.5, "a/face/face0": 0.5, "a/face/face1": 1.5, "a/posed": -0.5}.items():
        face = faces[name]
        assert isinstance(face, AnnotatedFace)
        np.testing.assert_allclose(face.landmarks2d, POINTS + first)
        assert face.image_path == tmp_path / "a" / f"{name.split('/')[1]}.jpg"
        assert face.follows_outline == (name != "a/posed")
        assert (face.depths_px is not None) == (name == "a/posed")


def test_the_folders_at_hand_are_found(shared_dir: Path) -> None:
    counts = {}
    for folder in ("300w", "dlib_faces", "300vw", "aflw2000_3d/dev", "foreign_mat"):
        faces = load_all(shared_dir / "data" / folder)
        counts[folder] = sum(isinstance(face, AnnotatedFace) for face in faces.values()), len(faces)
    assert counts == {
        "300w": (30, 30),
        "dlib_faces": (43, 43),
        "300vw": (4, 4),
        "aflw2000_3d/dev": (400, 400),
        "foreign_mat": (0, 2),
    }


def test_missing_parts_are_missing_points(tmp_path: Path) -> None:
    boxes = box().replace("<part name='05' x='10' y='11'/>", "")
    write_xml(tmp_path / "list.xml", {"face.jpg": boxes})
    (points,) = [points for _, points in read_dlib_xml(tmp_path / "list.xml")]
    assert isinstance(points, np.ndarray)
    assert np.isnan(points[5]).all()
    np.testing.assert_allclose(np.delete(points, 5, axis=0), np.delete(POINTS, 5, axis=0) + 0.5)


@pytest.mark.parametrize("marker", ["x='-1' y='-1'", "x='0' y='0'", "x='nan' y='9'"])
def test_marked_parts_are_missing_points(tmp_path: Path, marker: str) -> None:
    write_xml(tmp_path / "list.xml", {"face.jpg": box().replace("x='10' y='11'", marker)})
    (points,) = [points for _, points in read_dlib_xml(tmp_path / "list.xml")]
    assert isinstance(points, np.ndarray)
    assert np.flatnonzero(np.isnan(points).all(axis=1)).tolist() == [5]


def test_other_schemes_of_the_files_at_hand_are_read(shared_dir: Path) -> None:
    folder, refused = shared_dir / "data" / "aflw2000_3d" / "dev", []
    for annotation in [*find_annotations(folder, "inner51")[::10], *find_annotations(folder, "aflw21")]:
        try:
            annotation.load()
        except InputFileError:
            refused.append(annotation.name)
    assert refused == ["image01198"]  # that file has 23 points where the others have 21


def test_bad_faces_are_named_and_the_others_are_kept(tmp_path: Path) -> None:
    write_pts(tmp_path / "alone.pts")
    (tmp_path / "broken.pts").write_text("version: 1\nn_points: 68\n{\n1 2\n")
    (tmp_path / "noise.mat").write_bytes(b"noise")
    five = box(POINTS[:5])
    named = box().replace("name='67'", "name='chin'")
    write_xml(
        tmp_path / "list.xml", {"gone.jpg": box(), "five.jpg": five, "named.jpg": named + box(attributes="ignore='1'")}
    )
    write_pts(tmp_path / "good.pts")
    write_picture(tmp_path / "good.png")
    faces = load_all(tmp_path)
    assert isinstance(faces.pop("good"), AnnotatedFace)
    for name, message in {
        "alone": "expected its picture alone.jpg",
        "broken": "cut off",
        "noise": "expected a MAT 5 file",
        "gone/face0": "expected the picture .*gone.jpg",
        "five/face0": "found 5 parts",
        "named/face0": "one named 'chin'",
    }.items():
        with pytest.raises(InputFileError, match=message):
            raise InputFileError(faces.pop(name))
    assert not faces


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no element found"),
        ("<dataset><images>", "no element found"),
        ("<annotation/>", "begins with <annotation>"),
        ("<dataset><images><image/></images></dataset>", "KeyError: 'file'"),
        ("<dataset><image file='a'><box><part name='00' x='one' y='2'/></box></image></dataset>", "could not convert"),
        ("<!DOCTYPE d [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;'>]><dataset>&b;</dataset>", "declares the entity 'a'"),
        ("<!DOCTYPE d [<!ENTITY a SYSTEM 'file:///etc/hostname'>]><dataset>&a;</dataset>", "declares the entity"),
    ],
)
def test_other_xml_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "list.xml"
    path.write_text(text)
    with pytest.raises(InputFileError, match=message) as caught:
        read_dlib_xml(path)
    assert "list.xml" in str(caught.value)
    assert [*load_all(tmp_path).values()] == [str(caught.value)]


def test_damaged_xml_never_breaks_the_reader(tmp_path: Path) -> None:
    write_xml(tmp_path / "list.xml", {"a.jpg": box() + box()})
    content = (tmp_path / "list.xml").read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(200):
        damaged = bytearray(content[: rng.integers(1, len(content))])
        for position in rng.integers(len(damaged), size=3):
            damaged[position] = rng.integers(256)
        (tmp_path / "list.xml").write_bytes(damaged)
        with contextlib.suppress(InputFileError):
            read_dlib_xml(tmp_path / "list.xml")


def test_a_picture_in_two_lists_has_two_names(tmp_path: Path) -> None:
    for name in ("one.xml", "two.xml"):
        write_xml(tmp_path / name, {"face.jpg": box()})
    assert [annotation.name for annotation in find_annotations(tmp_path)] == ["face/face0", "face/face0#2"]


def test_nothing_to_find_is_said(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="found none there"):
        find_annotations(tmp_path / "nothing")
    with pytest.raises(UsageError, match=r"\.pts beside the picture, \.mat with pt3d_68"):
        find_annotations(tmp_path)


def test_names_in_any_case_are_found_and_folders_and_notes_of_macos_are_none(tmp_path: Path) -> None:
    write_pts(tmp_path / "upper.PTS")
    write_picture(tmp_path / "upper.JPG")
    write_pts(tmp_path / "._upper.pts")
    (tmp_path / "folder.pts").mkdir()
    (tmp_path / "folder.MAT").mkdir()
    write_pts(tmp_path / "folder.pts" / "inner.pts")
    write_picture(tmp_path / "folder.pts" / "inner.png")
    faces = load_all(tmp_path)
    assert list(faces) == ["folder", "folder#2", "folder.pts/inner", "upper"]
    assert isinstance(faces["upper"], AnnotatedFace)
    assert isinstance(faces["folder.pts/inner"], AnnotatedFace)
    for name in ("folder", "folder#2"):
        assert "found a folder; name a file in it" in str(faces[name])


def test_a_name_that_no_file_can_have_is_one_entry(tmp_path: Path) -> None:
    write_picture(tmp_path / "good.jpg")
    write_xml(tmp_path / "list.xml", {"x" * 300 + ".jpg": box(), "good.jpg": box(), "y" * 10**6: box()})
    faces = load_all(tmp_path)
    assert [isinstance(face, AnnotatedFace) for face in faces.values()] == [True, False, False]
    assert all(len(f"{name}{face}") < 1000 for name, face in faces.items() if isinstance(face, str))


@pytest.mark.parametrize("encoding", ["rot13", "utf-7", "zlib", "no-such", "idna"])
def test_an_encoding_that_is_none_of_text_is_refused(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "a.xml").write_text(f"<?xml version='1.0' encoding='{encoding}'?><dataset></dataset>")
    with pytest.raises(InputFileError, match=r"a\.xml: expected a list of faces in dlib's XML, found something else"):
        read_dlib_xml(tmp_path / "a.xml")


def test_a_long_attribute_is_read_in_a_moment(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(f"<dataset><image file='{'x' * 30_000_000}'><box/></image></dataset>")
    start = process_time()
    ((name, found),) = read_dlib_xml(tmp_path / "a.xml")
    # 2 s on a slow core. In parts of 64 kB, which are looked through again with each part that is added, 24 s.
    assert process_time() - start < 12
    assert name == "x" * 80 + "..."
    assert isinstance(found, InputFileError)
