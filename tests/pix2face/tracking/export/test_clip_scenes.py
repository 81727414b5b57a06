"""Clips as glTF and USD: other readers see the mesh of each frame where its camera saw it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray
from pxr import Usd, UsdGeom

from pix2face.fitting.face_fit import FaceFit, face_of_coefficients
from pix2face.geometry.camera import Camera, HeadPose, Pinhole, pinhole_camera, rotation_of_pose
from pix2face.tracking.export.clip_gltf import target_names, write_clip_glb
from pix2face.tracking.export.clip_scene import ClipScene
from pix2face.tracking.export.clip_usd import write_clip_usd
from tests.cameras import posed_camera
from tests.pix2face.scene_readers import GltfScene, usd_complaints, usd_pixels
from tests.synthetic_models import small_head_model

SIZE_PX = (360, 640)
MODEL = small_head_model()
IDENTITY = np.random.default_rng(0).normal(size=MODEL.n_identity)
MISSING = 2  # a frame without a face
FIRST, COUNT = 5, 4


def weak(index: int) -> Camera:
    pose = {"pitch_deg": 5 * index, "yaw_deg": 170 - 60 * index, "roll_deg": -8}
    return posed_camera(250, 140 + index, **pose, scale=1.2 + 0.1 * index)


def pinhole(index: int) -> Camera:
    rotation = rotation_of_pose(HeadPose(5, -35 + 20 * index, 7))
    place = np.array([-60.0, 30 + 5 * index, 700 - 30 * index])
    return pinhole_camera(Pinhole(900.0 + 50 * index, np.array([320.0, 180.0]), rotation, place))


def mixed(index: int) -> Camera:
    return weak(1) if index == 1 else pinhole(index)


# A mixture of both is seen by pinholes alone, one of which is far away.
KINDS = pytest.mark.parametrize(("camera", "within_px"), [(weak, 1e-3), (pinhole, 1e-3), (mixed, 0.1)])


def fit_of(camera: Camera, index: int) -> FaceFit:
    expression = 3 * np.random.default_rng(1 + index).normal(size=MODEL.n_expression)
    return face_of_coefficients(MODEL, camera, IDENTITY, expression)


def clip(camera_at) -> tuple[ClipScene, dict[int, ndarray]]:
    """A scene, and the pixels of the mesh in each of its frames that shows the face."""
    scene, pixels = ClipScene(MODEL, IDENTITY, SIZE_PX, 25.0), {}
    for index in range(COUNT):
        fit = None if index == MISSING else fit_of(camera_at(index), index)
        scene.add(FIRST + index, (FIRST + index) / 25, fit)
        if fit is not None:
            pixels[index] = fit.camera.project(fit.vertices)
    return scene, pixels


@KINDS
def test_gltf_shows_the_mesh_of_each_frame_at_its_place(tmp_path: Path, camera, within_px: float) -> None:
    scene, pixels = clip(camera)
    write_clip_glb(tmp_path / "track.glb", scene)
    found = GltfScene(tmp_path / "track.glb")
    for index, truth in pixels.items():
        np.testing.assert_allclose(found.pixels(SIZE_PX, index), truth, atol=within_px)
    assert np.ptp(found.points(MISSING), axis=0).max() == 0  # nothing to be seen
    assert (found.animated(1, "scale", MISSING - 1) > 0).all()
    (animation,) = found.tree.animations
    np.testing.assert_allclose(found.array(animation.samplers[0].input)[:, 0] * 25, range(FIRST, FIRST + COUNT))


def test_gltf_has_a_morph_target_for_each_component(tmp_path: Path) -> None:
    scene, _ = clip(weak)
    write_clip_glb(tmp_path / "track.glb", scene)
    found = GltfScene(tmp_path / "track.glb")
    (mesh,) = found.tree.meshes
    assert len(mesh.primitives[0].targets) == MODEL.n_expression == len(mesh.extras["targetNames"])
    np.testing.assert_array_equal(found.array(mesh.primitives[0].indices).reshape(-1, 3), MODEL.triangles)
    for key in (0, 1, 3):
        weights = found.animated(1, "weights", key)
        assert weights is not None
        assert weights.min() >= 0  # programs cut off others
        assert weights.max() <= 1
        deviations = (weights - mesh.extras["neutralWeights"]) * mesh.extras["deviationsPerWeight"]
        np.testing.assert_allclose(deviations, fit_of(weak(key), key).expression, atol=1e-5)
    assert target_names(MODEL) == ["jawOpen", *(f"expression{index:02d}" for index in range(1, 6))]


def test_a_model_without_expressions_moves_all_the_same(tmp_path: Path) -> None:
    still = replace(MODEL, expression_basis=MODEL.expression_basis[:0], named_expressions={})
    scene = ClipScene(still, IDENTITY, SIZE_PX, 25.0)
    fits = [face_of_coefficients(still, weak(index), IDENTITY, np.zeros(0)) for index in range(2)]
    for index, fit in enumerate(fits):
        scene.add(index, index / 25, fit)
    write_clip_glb(tmp_path / "track.glb", scene)
    write_clip_usd(tmp_path / "track.usdc", scene)
    for index, fit in enumerate(fits):
        truth = fit.camera.project(fit.vertices)
        np.testing.assert_allclose(GltfScene(tmp_path / "track.glb").pixels(SIZE_PX, index), truth, atol=1e-3)
        np.testing.assert_allclose(usd_pixels(tmp_path / "track.usdc", SIZE_PX, index), truth, atol=1e-3)


@KINDS
def test_usd_shows_the_mesh_of_each_frame_at_its_place(tmp_path: Path, camera, within_px: float) -> None:
    scene, pixels = clip(camera)
    write_clip_usd(tmp_path / "track.usdc", scene)
    assert [path.name for path in tmp_path.iterdir()] == ["track.usdc"]
    for index, truth in pixels.items():
        np.testing.assert_allclose(usd_pixels(tmp_path / "track.usdc", SIZE_PX, FIRST + index), truth, atol=within_px)
    stage = Usd.Stage.Open(str(tmp_path / "track.usdc"))
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (FIRST, FIRST + 3, 25)
    assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Y", 1.0)
    head = UsdGeom.Imageable(stage.GetPrimAtPath("/clip/head"))
    shown = [head.ComputeVisibility(Usd.TimeCode(FIRST + index)) for index in range(COUNT)]
    assert shown == ["invisible" if index == MISSING else "inherited" for index in range(COUNT)]
    assert UsdGeom.Mesh(stage.GetPrimAtPath("/clip/head/mesh")).GetSubdivisionSchemeAttr().Get() == "none"
    assert usd_complaints(tmp_path / "track.usdc") == []
