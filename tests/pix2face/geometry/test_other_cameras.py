"""Cameras in the forms of OpenCV, COLMAP and glTF project as the camera itself does."""

import cv2
import numpy as np
import pytest
from numpy import ndarray
from scipy.spatial.transform import Rotation

from pix2face.geometry.camera import (
    Camera,
    HeadPose,
    Pinhole,
    WeakPerspective,
    pinhole_camera,
    rotation_of_pose,
    weak_perspective_camera,
)
from pix2face.geometry.other_cameras import colmap_camera, gltf_camera, opencv_camera

SIZE_PX = (360, 640)
ROTATION = rotation_of_pose(HeadPose(12, -35, 7))
WEAK = weak_perspective_camera(WeakPerspective(1.5, ROTATION, np.array([250.0, 140.0])))
PINHOLE = pinhole_camera(Pinhole(900.0, np.array([320.0, 180.0]), ROTATION, np.array([-60.0, 30.0, 700.0])))
POINTS_MM = np.random.default_rng(0).uniform(-100, 100, (50, 3))
CAMERAS = pytest.mark.parametrize(("camera", "within_px"), [(WEAK, 0.03), (PINHOLE, 1e-6)], ids=["weak", "pinhole"])


def projected_by_gltf(form: dict, points_m: ndarray, size_px: tuple[int, int] = SIZE_PX) -> ndarray:
    """Pixels as glTF 2.0 defines them (Sec. 3.10.3): clip space from the projection matrices of its appendix."""
    camera_from_world = np.linalg.inv(np.reshape(form["matrix"], (4, 4), order="F"))
    x, y, z = (np.column_stack([points_m, np.ones(len(points_m))]) @ camera_from_world.T)[:, :3].T
    lens = form["camera"][form["camera"]["type"]]
    assert (z < -lens["znear"]).all()  # in front
    if form["camera"]["type"] == "perspective":
        half = np.tan(lens["yfov"] / 2)
        right, up = x / -z / half / lens["aspectRatio"], y / -z / half
    else:
        assert (z > -lens["zfar"]).all()
        right, up = x / lens["xmag"], y / lens["ymag"]
    return np.column_stack([(right + 1) / 2 * size_px[1], (1 - up) / 2 * size_px[0]])


@CAMERAS
def test_opencv_projects_the_same_pixels_half_a_pixel_less(camera: Camera, within_px: float) -> None:
    form = opencv_camera(camera)
    assert form is not None
    matrices = [np.array(form[name]) for name in ("rotation", "translation_mm", "camera_matrix")]
    pixels, _ = cv2.projectPoints(POINTS_MM, cv2.Rodrigues(matrices[0])[0], matrices[1], matrices[2], None)
    np.testing.assert_allclose(pixels[:, 0] + 0.5, camera.project(POINTS_MM), atol=within_px)


@CAMERAS
def test_colmap_projects_the_same_pixels(camera: Camera, within_px: float) -> None:
    form = colmap_camera(camera, SIZE_PX)
    assert form is not None
    assert (form["model"], form["width"], form["height"]) == ("SIMPLE_PINHOLE", 640, 360)
    w, x, y, z = form["qvec"]
    seen = Rotation.from_quat([x, y, z, w]).apply(POINTS_MM) + form["tvec_mm"]
    focal, *principal_point = form["params"]
    np.testing.assert_allclose(
        focal * seen[:, :2] / seen[:, 2:] + principal_point, camera.project(POINTS_MM), atol=within_px
    )


@pytest.mark.parametrize("camera", [WEAK, PINHOLE], ids=["weak", "pinhole"])
def test_gltf_projects_the_same_pixels(camera: Camera) -> None:
    form = gltf_camera(camera, SIZE_PX)
    assert form is not None
    np.testing.assert_allclose(projected_by_gltf(form, POINTS_MM / 1000), camera.project(POINTS_MM), atol=1e-6)


def test_what_a_form_cannot_express_is_left_out() -> None:
    affine = Camera(np.diag([1.1, 1, 1, 1]) @ WEAK.matrix)
    assert opencv_camera(affine) is colmap_camera(affine, SIZE_PX) is gltf_camera(affine, SIZE_PX) is None
    assert gltf_camera(PINHOLE, (360, 600)) is None
