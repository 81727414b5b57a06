"""A row of a table that cannot be used costs itself, never its neighbours."""

import json
import os
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from datagen.cli import main
from datagen.sampling.faces import sample_faces
from pix2face.face_files.coefficients import FaceCoefficients, save_coefficients
from pix2face.geometry.camera import FRONTAL, Pinhole, pinhole_camera
from pix2face.models.morphable_model import load_model
from pix2face.shards.layers import DEFAULT_LAYERS
from pix2face.shards.shard_checks import verify_shard
from pix2face.shards.shard_reader import ShardReader, shard_paths
from tests.model_files import write_small_head
from tests.pix2face.benchmark_files import frontal_camera, write_mat
from tests.pix2face.files.test_picture_head import png_bomb

pytestmark = pytest.mark.gl

SIZE_PX = 48


@pytest.fixture(scope="module")
def model_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_small_head(tmp_path_factory.mktemp("model") / "head.h5")


def reasons(table: FaceCoefficients, model_path: Path, folder: Path) -> dict[str, str]:
    """Renders a table whose first row is good and all others are bad; why each was rejected."""
    save_coefficients(table, folder / "faces.h5")
    arguments = ["--coeffs", str(folder / "faces.h5"), "--out", str(folder / "out"), "--model", str(model_path)]
    layers = ",".join((*DEFAULT_LAYERS, "depth"))
    assert main(["render", *arguments, "--workers", "1", "--layers", layers]) == 3
    (path,) = shard_paths(folder / "out")
    assert verify_shard(path) == []
    reader = ShardReader(path)
    assert reader.sample_ids == [table.sample_ids[0]]
    lines = (folder / "out" / "rejected.jsonl").read_text().splitlines()
    found = {entry["sample_id"]: entry["reason"] for entry in map(json.loads, lines)}
    assert set(found) == set(table.sample_ids[1:])
    return found


def test_numbers_that_no_face_has(model_path: Path, tmp_path: Path) -> None:
    table = sample_faces(load_model(model_path), 8, 0, SIZE_PX)
    names = ("good", "huge identity", "overflow", "far", "beside", "flat", "enormous picture", "behind")
    identity, sizes = table.identity.copy(), table.sizes_px.copy()
    cameras = np.tile(frontal_camera(0.1, SIZE_PX / 2).matrix, (8, 1, 1))
    identity[1, 0], identity[2] = 200, 3e38
    cameras[3, 2, 3] = 1e9
    cameras[4, 0, 3] = 1e5
    cameras[5, 1] = cameras[5, 0]
    sizes[6] = 16384
    away_mm = np.array([0.0, 0.0, -500.0])
    cameras[7] = pinhole_camera(Pinhole(60.0, np.full(2, SIZE_PX / 2), FRONTAL, away_mm)).matrix
    found = reasons(
        replace(table, sample_ids=names, identity=identity, cameras=cameras, sizes_px=sizes), model_path, tmp_path
    )
    assert "expected offset within ±255.9 mm" in found["huge identity"]
    assert "finite vertices" in found["overflow"]
    assert "expected depth within" in found["far"]
    assert "nothing of the face" in found["beside"]
    assert "independent rows" in found["flat"]
    assert "draws no larger ones" in found["enormous picture"]
    assert "in front of the camera" in found["behind"]


def test_files_of_a_folder_that_are_none(model_path: Path, tmp_path: Path) -> None:
    """Pipes, devices, bombs, loops of links: none hangs, none fills memory, each is listed."""
    folder = tmp_path / "faces"
    model = load_model(model_path)
    camera = frontal_camera(0.25, SIZE_PX / 2)
    pixels = camera.project(model.mean[model.landmarks["ibug68"]].astype(np.float64))
    jpeg = cv2.imencode(".jpg", np.full((SIZE_PX, SIZE_PX, 3), 99, np.uint8))[1].tobytes()
    for name in ("a good", "bomb", "empty", "zeros", "cut"):
        pose = np.array([[0, 0, 0, SIZE_PX / 2, SIZE_PX / 2, 0, 0.25e-3]])
        points = np.vstack([pixels.T + 0.5, np.zeros(68)])
        write_mat(folder / f"{name}.mat", pixels, 0.0, pt3d_68=points, Pose_Para=pose)
        (folder / f"{name}.jpg").write_bytes(jpeg)
    (folder / "bomb.jpg").write_bytes(png_bomb())
    (folder / "empty.jpg").write_bytes(b"")
    (folder / "cut.jpg").write_bytes(jpeg[:-2])
    (folder / "zeros.jpg").unlink()
    (folder / "zeros.jpg").symlink_to("/dev/zero")
    os.mkfifo(folder / "pipe.mat")
    (folder / "device.mat").symlink_to("/dev/zero")
    (folder / "nowhere.mat").symlink_to(folder / "nothing.mat")
    (folder / "self.mat").symlink_to(folder / "self.mat")
    for name, target in (("up", folder), ("round", folder / "round")):
        (folder / name).symlink_to(target)
    for name in ("pipe", "device", "nowhere", "self"):
        (folder / f"{name}.jpg").write_bytes(jpeg)
    out = tmp_path / "out"
    arguments = ["--coeffs", str(folder), "--out", str(out), "--model", str(model_path), "--workers", "1"]
    assert main(["render", *arguments]) == 3
    reader = ShardReader(shard_paths(out)[0])
    assert reader.sample_ids == ["a good"]
    lines = (out / "rejected.jsonl").read_text().splitlines()
    found = {entry["sample_id"]: entry["reason"] for entry in map(json.loads, lines)}
    assert list(found) == ["bomb", "cut", "device", "empty", "nowhere", "pipe", "self", "zeros"]
    assert "megapixels, found a head" in found["bomb"]
    assert "found 0 bytes that are none" in found["empty"]
    assert "found a device, pipe or socket" in found["device"]
    assert "found no such file" in found["nowhere"]
    assert "cannot read it" in found["self"]


def test_a_photograph_without_right_to_read_is_rejected(model_path: Path, tmp_path: Path) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may read everything")
    jpeg = cv2.imencode(".jpg", np.full((SIZE_PX, SIZE_PX, 3), 99, np.uint8))[1].tobytes()
    for name in ("good", "closed"):
        (tmp_path / f"{name}.jpg").write_bytes(jpeg)
    (tmp_path / "closed.jpg").chmod(0)
    names = ("good", "closed")
    table = sample_faces(load_model(model_path), len(names), 0, SIZE_PX)
    table = replace(table, sample_ids=names, image_paths=tuple(f"{name}.jpg" for name in names))
    assert "cannot read it" in reasons(table, model_path, tmp_path)["closed"]


def test_photographs_that_are_none(model_path: Path, tmp_path: Path) -> None:
    jpeg = cv2.imencode(".jpg", np.full((SIZE_PX, SIZE_PX, 3), 99, np.uint8))[1].tobytes()
    (tmp_path / "good.jpg").write_bytes(jpeg)
    (tmp_path / "truncated.jpg").write_bytes(jpeg[:100])
    (tmp_path / "empty.jpg").write_bytes(b"")
    (tmp_path / "folder.jpg").mkdir()
    cv2.imwrite(str(tmp_path / "larger.jpg"), np.zeros((SIZE_PX, SIZE_PX + 1, 3), np.uint8))
    names = ("good", "truncated", "empty", "folder", "larger", "missing")
    table = sample_faces(load_model(model_path), len(names), 0, SIZE_PX)
    table = replace(table, sample_ids=names, image_paths=tuple(f"{name}.jpg" for name in names))
    found = reasons(table, model_path, tmp_path)
    for name in names[1:]:
        assert f"{name}.jpg: expected a picture" in found[name]
    assert "48 x 48 pixels, as the table says, found 49 x 48" in found["larger"]
    reader = ShardReader(shard_paths(tmp_path / "out")[0])
    assert reader.read(0).image_bytes == jpeg
