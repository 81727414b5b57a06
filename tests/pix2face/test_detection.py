"""The packed detector finds faces, and its boxes are those of the landmarks."""

import xml.etree.ElementTree as ET
from pathlib import Path

import cv2
import numpy as np
import pytest
from skimage.data import astronaut

from pix2face.crops import FaceBox
from pix2face.detection import detect_faces
from pix2face.images import read_photograph

# Read off the picture: brows at y 95, chin at y 170, the sides of the face at x 180 and 265.
ASTRONAUT_FACE = FaceBox(180, 93, 265, 170)


def overlap(a: FaceBox, b: FaceBox) -> float:
    """Intersection over union."""
    width = min(a.right, b.right) - max(a.left, b.left)
    height = min(a.bottom, b.bottom) - max(a.top, b.top)
    common = max(width, 0) * max(height, 0)
    return common / (a.width * a.height + b.width * b.height - common)


def test_finds_the_astronaut():
    boxes = detect_faces(astronaut())
    assert overlap(boxes[0], ASTRONAUT_FACE) > 0.7
    assert boxes == sorted(boxes, key=lambda box: -box.longer_side)


def test_boxes_grow_with_the_picture():
    larger = cv2.resize(astronaut(), None, fx=3, fy=3, interpolation=cv2.INTER_LINEAR)
    found = detect_faces(larger)[0]
    third = FaceBox(found.left / 3, found.top / 3, found.right / 3, found.bottom / 3)
    assert overlap(third, ASTRONAUT_FACE) > 0.7


@pytest.mark.parametrize("shape", [(300, 200, 3), (10, 2000, 3), (1, 1, 3)])
def test_a_picture_without_a_face_has_no_box(shape):
    assert detect_faces(np.full(shape, 128, dtype=np.uint8)) == []


def annotated_faces(folder: Path) -> dict[str, list[FaceBox]]:
    faces: dict[str, list[FaceBox]] = {}
    for path in sorted(folder.glob("*_with_face_landmarks.xml")):
        for image in ET.parse(path).getroot().iter("image"):
            for box in image.iter("box"):
                points = [[float(part.get("x")) + 0.5, float(part.get("y")) + 0.5] for part in box.iter("part")]
                faces.setdefault(image.get("file"), []).append(FaceBox.around(np.array(points)))
    return faces


def test_recall_and_box_error_on_annotated_photographs(shared_dir):
    folder = shared_dir / "data" / "dlib_faces"
    n_faces, n_false, overlaps = 0, 0, []
    for name, faces in annotated_faces(folder).items():
        found = detect_faces(read_photograph(folder / name))
        best = [max((overlap(face, box) for box in found), default=0) for face in faces]
        overlaps += [value for value in best if value > 0.5]
        n_faces += len(faces)
        n_false += sum(max(overlap(face, box) for face in faces) < 0.3 for box in found)
    assert n_faces == 43
    assert len(overlaps) >= 32
    assert n_false <= 3
    assert np.median(overlaps) > 0.8
