"""A fit comes back from its file; files that are none are named."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pix2face.errors import InputFileError, ModelMismatchError
from pix2face.face_files.w300lp import PoseParameters, camera_of_pose
from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.camera import (
    Camera,
    HeadPose,
    Pinhole,
    WeakPerspective,
    pinhole_camera,
    rotation_of_pose,
    weak_perspective_camera,
)
from pix2face.photographs.fit_files import fit_to_json, read_fit
from tests.pix2face.photographs.seen_faces import HEIGHT_PX, photographed_face
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
SIZE_PX = (HEIGHT_PX, 200)


def fitted() -> FaceFit:
    face = photographed_face(MODEL)
    landmarks3d = face.vertices[MODEL.landmarks["ibug68"]].astype(np.float64)
    return FaceFit(
        face.camera,
        face.identity,
        face.expression,
        MODEL,
        face.landmarks2d,
        landmarks3d,
        None,
        None,
        np.arange(1.0, 69.0),
    )


def write(folder: Path, photograph: str = "in/person.jpg") -> Path:
    path = folder / "out" / "person.json"
    path.parent.mkdir(exist_ok=True)
    path.write_text(fit_to_json(fitted(), f"../{photograph}", SIZE_PX), encoding="ascii")
    return path


@pytest.mark.parametrize("photograph", ["in/person.jpg", "person.jpg", "caf\udce9/</script>.jpg"])
def test_a_fit_comes_back(tmp_path: Path, photograph: str) -> None:
    (stored, path), given = read_fit(write(tmp_path, photograph), MODEL), fitted()
    np.testing.assert_array_equal(stored.camera.matrix, given.camera.matrix)
    for name in ("identity", "expression", "landmarks2d", "landmarks3d", "landmark_errors_px"):
        np.testing.assert_array_equal(getattr(stored, name), getattr(given, name))
    np.testing.assert_allclose(stored.vertices, given.vertices)
    assert path.resolve() == tmp_path / photograph


def test_the_folder_may_move_with_its_photographs(tmp_path: Path) -> None:
    write(tmp_path)
    (tmp_path / "out").rename(tmp_path / "elsewhere")
    _, photograph = read_fit(tmp_path / "elsewhere" / "person.json", MODEL)
    assert photograph.resolve() == tmp_path / "in" / "person.jpg"


def test_a_fit_of_another_model_names_both(tmp_path: Path) -> None:
    other = replace(MODEL, name="another head", sha256="1" * 64)
    with pytest.raises(ModelMismatchError, match=r"'small synthetic head'.*'another head'.*--model"):
        read_fit(write(tmp_path), other)


@pytest.mark.parametrize("content", [b"", b"{", b"[1, 2]", b"3", b"\xff\xfe\x00", b"[" * 100_000, b'{"model": 3}'])
def test_what_is_no_fit_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "fit.json"
    path.write_bytes(content)
    with pytest.raises(InputFileError, match=r"fit\.json: expected a fit that `pix2face fit` wrote"):
        read_fit(path, MODEL)


def test_missing_files_folders_and_giants_are_named(tmp_path: Path) -> None:
    for path in (tmp_path / "nothing.json", tmp_path):
        with pytest.raises(InputFileError, match=r"found (no such file|a folder)"):
            read_fit(path, MODEL)
    giant = tmp_path / "giant.json"
    with giant.open("wb") as file:
        file.truncate(1 << 33)  # a sparse file: must be refused without being read
    with pytest.raises(InputFileError, match="found 8192 MB"):
        read_fit(giant, MODEL)


BAD_FIELDS: list[tuple[str, Any]] = [
    ("camera_matrix", [[1, 2], [3, 4]]),
    ("camera_matrix", "nonsense"),
    ("identity", [0.0]),
    ("expression", None),
    ("expression", [10**400] * 8),
    ("landmarks2d_px", [[1, 2, 3]]),
    ("landmarks3d_mm", [[1, [2], 3]]),
    ("landmark_errors_px", [1.0, 2.0]),
    ("model", {"name": "x"}),
]


@pytest.mark.parametrize(("name", "value"), BAD_FIELDS)
def test_a_bad_field_is_named(tmp_path: Path, name: str, value: Any) -> None:
    path = write(tmp_path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {name: value}))
    with pytest.raises(InputFileError, match=rf"without a valid '({name}|sha256)'"):
        read_fit(path, MODEL)


def test_numbers_are_finite(tmp_path: Path) -> None:
    path = write(tmp_path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"identity": [float("nan")] * 12}))
    with pytest.raises(InputFileError, match="NaN is not finite"):
        read_fit(path, MODEL)


def test_the_file_says_what_the_camera_is() -> None:
    near = pinhole_camera(Pinhole(800.0, np.array([130.0, 110.0]), np.diag([1.0, -1, -1]), np.array([0, 0, 600.0])))
    stretched = replace(fitted(), camera=Camera(np.diag([1.1, 1, 1, 1]) @ fitted().camera.matrix))
    kinds = {"weak-perspective": fitted(), "affine": stretched, "pinhole": replace(fitted(), camera=near)}
    for kind, fit in kinds.items():
        fields = json.loads(fit_to_json(fit, "person.jpg", SIZE_PX))
        assert fields["camera_kind"] == kind
        assert fields["focal_px"] == (pytest.approx(800) if kind == "pinhole" else None)


def test_the_published_pose_leads_back_to_the_camera() -> None:
    pitch, yaw, roll, tx, ty, tz, scale = json.loads(fit_to_json(fitted(), "x.jpg", SIZE_PX))["pose_para"]
    head = HeadPose(*np.degrees([pitch, yaw, roll]))
    camera = camera_of_pose(PoseParameters(head=head, translation_px=np.array([tx, ty, tz]), scale=scale), HEIGHT_PX)
    np.testing.assert_allclose(camera.project(fitted().landmarks3d), fitted().landmarks2d, atol=1e-6)


def test_beyond_a_profile_each_pose_has_its_own_range() -> None:
    """``pose_deg`` says how far the head is turned; ``pose_para`` is what tools of 300W-LP compute."""
    rotation = rotation_of_pose(HeadPose(12, 100, -5))
    turned = replace(fitted(), camera=weak_perspective_camera(WeakPerspective(1.5, rotation, np.full(2, 90.0))))
    fields = json.loads(fit_to_json(turned, "x.jpg", SIZE_PX))
    stated = [fields["pose_deg"][name] for name in ("pitch", "yaw", "roll")]
    np.testing.assert_allclose(stated, [12, 100, -5], atol=1e-6)
    published = np.degrees(fields["pose_para"][:3])
    np.testing.assert_allclose(published, [-168, 80, 175], atol=1e-6)
