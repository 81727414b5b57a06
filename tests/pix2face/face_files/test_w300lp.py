"""The reader of 300W-LP files against the files themselves and against damage."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.face_files.w300lp import (
    CoefficientFile,
    PoseParameters,
    camera_of_pose,
    check_picture_height,
    read_aflw21_landmarks,
    read_coefficient_file,
    read_landmark_file,
)
from pix2face.geometry.camera import HeadPose, head_pose, rotation_of_pose
from tests.keypoint_model import design_row, fit_keypoint_model_to, points_of_pose, unposed_mm


def keypoint_residual_px(
    files: list[CoefficientFile], height_px: int = 450, shift_px: tuple[float, float] = (0, 0)
) -> float:
    """The exact check of docs/reference/conventions.md: undo each pose with our camera, regress on the coefficients.

    The 204 coordinates of the undone ``pt3d_68`` must be linear in the coefficients, since they are keypoints of a
    linear model. What is left over, in pixels, tells whether every part of the convention is right.
    """
    shifted = [replace(file, landmarks3d=file.landmarks3d + np.append(shift_px, 0)) for file in files]
    unposed = np.stack([unposed_mm(file, height_px).ravel() for file in shifted])
    design = np.stack([design_row(file) for file in files])
    design /= np.abs(design).max(axis=0)
    residual_mm = unposed - design @ np.linalg.lstsq(design, unposed, rcond=None)[0]
    return float(np.abs(residual_mm * [[1000 * file.pose.scale] for file in files]).max())


def test_exact_check_holds(dev_files: list[CoefficientFile]) -> None:
    assert len(dev_files) == 400
    assert keypoint_residual_px(dev_files) < 1e-3  # the file's float32 pixels resolve 3e-5


@pytest.mark.parametrize("shift", [(0.5, 0), (0, 0.5), (-0.5, 0), (0, -0.5), (1, -1)])
def test_exact_check_fails_when_pixels_are_off(dev_files: list[CoefficientFile], shift: tuple[float, float]) -> None:
    assert keypoint_residual_px(dev_files, shift_px=shift) > 0.04


@pytest.mark.parametrize("height", [449, 451])
def test_exact_check_fails_for_another_height(dev_files: list[CoefficientFile], height: int) -> None:
    assert keypoint_residual_px(dev_files, height_px=height) > 0.04


@pytest.mark.parametrize("signs", [(-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, -1)])
def test_exact_check_fails_for_other_signs(
    dev_files: list[CoefficientFile], signs: tuple[int, int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    original = rotation_of_pose

    def other_signs(pose: HeadPose) -> ndarray:
        return original(HeadPose(signs[0] * pose.pitch_deg, signs[1] * pose.yaw_deg, signs[2] * pose.roll_deg))

    monkeypatch.setattr("pix2face.face_files.w300lp.rotation_of_pose", other_signs)
    assert keypoint_residual_px(dev_files) > 1


def test_exact_check_fails_for_another_order_of_rotations(
    dev_files: list[CoefficientFile], monkeypatch: pytest.MonkeyPatch
) -> None:
    original = rotation_of_pose

    def reversed_order(pose: HeadPose) -> ndarray:
        x, y, z = HeadPose(pose.pitch_deg, 0, 0), HeadPose(0, pose.yaw_deg, 0), HeadPose(0, 0, pose.roll_deg)
        flip = original(HeadPose(0, 0, 0))
        return original(z) @ flip @ original(y) @ flip @ original(x)

    monkeypatch.setattr("pix2face.face_files.w300lp.rotation_of_pose", reversed_order)
    assert keypoint_residual_px(dev_files) > 1


def test_mean_face_lands_where_the_convention_says(shared_dir: Path) -> None:
    folder = shared_dir / "models" / "bfm_mean"
    mean_um = np.load(folder / "u_shp.npy").ravel() + np.load(folder / "u_exp.npy").ravel()
    keypoints = np.load(folder / "keypoints_sim.npy")[::3] // 3
    file = read_coefficient_file(shared_dir / "data" / "300wlp" / "IBUG_image_008_1_0.mat")
    assert file.landmarks2d is not None
    projected = camera_of_pose(file.pose, 450).project(mean_um.reshape(-1, 3)[keypoints] / 1000)
    distance = np.linalg.norm(projected - file.landmarks2d, axis=1)[17:].mean()
    assert 6.9 <= distance <= 7.0


def test_posed_points_equal_the_camera_in_the_authors_frame() -> None:
    rng = np.random.default_rng(0)
    points_um = rng.normal(0, 50_000, (20, 3))
    pose = PoseParameters(head=HeadPose(12, -70, 25), translation_px=np.array([210.0, 190.0, -60.0]), scale=0.0012)
    posed = points_of_pose(points_um, pose, 450)
    camera = camera_of_pose(pose, 450)
    np.testing.assert_allclose(camera.project(points_um / 1000), posed[:, :2] - 0.5, atol=1e-9)
    nearer = np.argsort(posed[:, 2])[::-1]
    np.testing.assert_array_equal(np.argsort(camera.depth(points_um / 1000)), nearer)


def test_negative_scale_gives_the_same_pixels_the_right_side_out() -> None:
    points_um = np.random.default_rng(1).normal(0, 50_000, (20, 3))
    pose = PoseParameters(head=HeadPose(150, 20, -170), translation_px=np.array([210.0, 190.0, 5.0]), scale=-0.0012)
    camera = camera_of_pose(pose, 450)
    np.testing.assert_allclose(
        camera.project(points_um / 1000), points_of_pose(points_um, pose, 450)[:, :2] - 0.5, atol=1e-9
    )
    rows = camera.matrix[:3, :3]
    assert np.linalg.det(rows) > 0


def test_landmarks_of_a_negative_scale_are_the_right_side_out(tmp_path: Path) -> None:
    points_um = np.random.default_rng(2).normal(0, 50_000, (68, 3))
    pose = PoseParameters(head=HeadPose(150, 20, -170), translation_px=np.array([210.0, 190.0, 5.0]), scale=-0.0012)
    angles = np.radians([150, 20, -170])
    numbers = np.concatenate([angles, pose.translation_px, [pose.scale]])[None]
    path = write_mat(tmp_path / "face.mat", Pose_Para=numbers, pt3d_68=points_of_pose(points_um, pose, 450).T)
    file = read_coefficient_file(path)
    assert file.landmarks3d is not None
    camera = camera_of_pose(file.pose, 450)
    np.testing.assert_allclose(file.landmarks3d[:, :2], camera.project(points_um / 1000), atol=1e-6)
    depth_px = camera.depth(points_um / 1000) * np.linalg.norm(camera.matrix[0, :3])
    np.testing.assert_allclose(np.diff(file.landmarks3d[:, 2]), np.diff(depth_px), atol=1e-6)


@pytest.mark.parametrize(
    ("pose", "nose_moves", "top_moves"),
    [
        (HeadPose(20, 0, 0), (0, -1), None),  # pitch: looks up, the nose rises
        (HeadPose(0, 20, 0), (-1, 0), None),  # yaw: the nose goes to the image's left
        (HeadPose(0, 0, 20), (0, 0), (1, None)),  # roll: the top of the head goes to the image's right
    ],
)
def test_signs_of_the_angles_in_words(
    pose: HeadPose, nose_moves: tuple[int, int], top_moves: tuple[int, None] | None
) -> None:
    parameters = PoseParameters(head=pose, translation_px=np.array([200.0, 200.0, 0.0]), scale=0.001)
    frontal = PoseParameters(head=HeadPose(0, 0, 0), translation_px=parameters.translation_px, scale=0.001)
    points = np.array([[0.0, 0, 100], [0, 100, 0]])
    moved = camera_of_pose(parameters, 400).project(points) - camera_of_pose(frontal, 400).project(points)
    assert tuple(np.sign(np.round(moved[0], 6))) == nose_moves
    if top_moves:
        assert np.sign(moved[1, 0]) == top_moves[0]


def test_pose_of_the_camera_is_that_of_the_file(dev_files: list[CoefficientFile]) -> None:
    for file in dev_files:
        angles = np.array([file.pose.head.pitch_deg, file.pose.head.yaw_deg, file.pose.head.roll_deg])
        if np.abs(angles).max() < 89:
            found = head_pose(camera_of_pose(file.pose, 450))
            np.testing.assert_allclose([found.pitch_deg, found.yaw_deg, found.roll_deg], angles, atol=1e-6)


def write_mat(path: Path, **fields: object) -> Path:
    values: dict[str, object] = {
        "Shape_Para": np.zeros((199, 1)),
        "Exp_Para": np.zeros((29, 1)),
        "Pose_Para": np.array([[0, 0, 0, 225, 225, 0, 0.001]]),
    }
    values.update(fields)
    scipy.io.savemat(path, {name: value for name, value in values.items() if value is not None})
    return path


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"Exp_Para": None}, "Exp_Para"),
        ({"Shape_Para": np.zeros((198, 1))}, "expected 199 numbers in Shape_Para, found 198"),
        ({"Pose_Para": np.array([[0, np.nan, 0, 1, 1, 1, 1]])}, "expected finite numbers in Pose_Para"),
        ({"Pose_Para": "seven"}, "Pose_Para should be an array of numbers and is text"),
        ({"Pose_Para": np.array([[0, 0, 0, 225, 225, 0, 0]])}, "expected a scale in Pose_Para, found 0"),
        ({"Illum_Para": np.zeros((1, 9))}, "expected 10 numbers in Illum_Para, found 9"),
        ({"pt3d_68": np.zeros((3, 67))}, r"expected pt3d_68 of shape \(3, 68\) or \(68, 3\), found \(3, 67\)"),
        ({"pt3d_68": np.ones((1, 204))}, r"expected pt3d_68 of shape .* found \(1, 204\)"),
    ],
)
def test_bad_content_is_named(tmp_path: Path, fields: dict[str, object], message: str) -> None:
    with pytest.raises(InputFileError, match=message):
        read_coefficient_file(write_mat(tmp_path / "face.mat", **fields))


@pytest.mark.parametrize("fraction", [0, 0.01, 0.3, 0.6, 0.95])
def test_truncated_files_are_refused(tmp_path: Path, fraction: float) -> None:
    path = write_mat(tmp_path / "face.mat", pt3d_68=np.ones((3, 68)))
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * fraction)])
    with pytest.raises(InputFileError, match=r"face\.mat"):
        read_coefficient_file(path)


def test_foreign_files_are_refused_by_name(shared_dir: Path) -> None:
    paths = sorted((shared_dir / "data" / "foreign_mat").glob("*.mat"))
    assert paths
    for path in paths:
        with pytest.raises(InputFileError, match="missing are Shape_Para"):
            read_coefficient_file(path)


def test_huge_files_are_refused(tmp_path: Path) -> None:
    huge = tmp_path / "huge.mat"
    huge.write_bytes(b"\0" * (5 << 20))
    with pytest.raises(InputFileError, match="found 5 MB"):
        read_coefficient_file(huge)


def test_dtypes_vary_and_are_cast(tmp_path: Path) -> None:
    path = write_mat(
        tmp_path / "face.mat", Shape_Para=np.ones((199, 1), np.float32), Exp_Para=np.ones((1, 29), np.int16)
    )
    file = read_coefficient_file(path)
    assert file.identity.dtype == file.expression.dtype == np.float64
    assert file.landmarks2d is None
    assert file.landmarks3d is None
    assert file.lighting is None


def test_lighting_is_read_where_it_is_there(tmp_path: Path) -> None:
    lighting = np.arange(10.0)
    file = read_coefficient_file(write_mat(tmp_path / "face.mat", Illum_Para=lighting[None]))
    np.testing.assert_array_equal(file.lighting, lighting)


def test_landmark_files_prefer_the_models_own_points(tmp_path: Path) -> None:
    path = tmp_path / "face_pts.mat"
    scipy.io.savemat(path, {"pts_2d": np.ones((68, 2)), "pts_3d": np.full((68, 2), 7.0)})
    np.testing.assert_array_equal(read_landmark_file(path), np.full((68, 2), 6.5))
    scipy.io.savemat(path, {"pts_2d": np.full((68, 2), 3.0)})
    np.testing.assert_array_equal(read_landmark_file(path), np.full((68, 2), 2.5))
    scipy.io.savemat(path, {"pts_2d": np.zeros((67, 2))})
    with pytest.raises(InputFileError, match=r"expected pts_2d of shape \(2, 68\) or \(68, 2\), found \(67, 2\)"):
        read_landmark_file(path)


def test_transposed_points_are_read_as_what_they_are(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    points3d, points2d = rng.uniform(1, 400, (3, 68)), rng.uniform(1, 400, (2, 68))
    usual = read_coefficient_file(write_mat(tmp_path / "a.mat", pt3d_68=points3d, pt2d=points2d))
    turned = read_coefficient_file(write_mat(tmp_path / "b.mat", pt3d_68=points3d.T, pt2d=points2d.T))
    np.testing.assert_array_equal(turned.landmarks3d, usual.landmarks3d)
    np.testing.assert_array_equal(turned.landmarks2d, usual.landmarks2d)
    scipy.io.savemat(tmp_path / "c_pts.mat", {"pts_2d": points2d})
    np.testing.assert_array_equal(read_landmark_file(tmp_path / "c_pts.mat"), points2d.T - 0.5)


def test_missing_points_are_missing(tmp_path: Path) -> None:
    points3d = np.random.default_rng(0).uniform(1, 400, (3, 68))
    points3d[:, 3], points3d[0, 9], points3d[:2, 11] = -1, np.nan, 0
    file = read_coefficient_file(write_mat(tmp_path / "a.mat", pt3d_68=points3d))
    assert file.landmarks3d is not None
    assert np.flatnonzero(np.isnan(file.landmarks3d).all(axis=1)).tolist() == [3, 9, 11]
    assert np.isnan(file.landmarks3d).sum() == 9


def test_a_file_beside_a_picture_of_another_height_is_told(dev_files: list[CoefficientFile]) -> None:
    for file in dev_files:
        check_picture_height(file, 450)
        for height_px in (224, 400, 500, 900):
            with pytest.raises(InputFileError, match="was the picture resized"):
                check_picture_height(file, height_px)


def test_the_linear_model_of_the_landmarks_holds_for_files_that_it_has_not_seen(
    dev_files: list[CoefficientFile],
) -> None:
    """The exact check is no tautology: 300 files (the rank is 229) predict the other 100."""
    model = fit_keypoint_model_to(dev_files[:300])
    errors = [
        np.abs(camera_of_pose(file.pose, 450).project(model.keypoints_mm(file)) - file.landmarks3d[:, :2]).max()
        for file in dev_files[300:]
        if file.landmarks3d is not None
    ]
    assert len(errors) == 100
    assert max(errors) < 0.01


def test_the_21_points_of_aflw_lie_where_the_68_do(shared_dir):
    """An independent check: the outer eye corners of both schemes (AFLW's points 7 and 12, 1-based) agree."""
    folder = shared_dir / "data/aflw2000_3d/dev"
    distances = []
    for path in sorted(folder.glob("*.mat"))[:80]:
        points, file = read_aflw21_landmarks(path), read_coefficient_file(path)
        for ours, theirs in ((6, 36), (11, 45)):
            size = np.ptp(file.landmarks3d[:, :2], axis=0).prod() ** 0.5
            distances.append(np.linalg.norm(points[ours] - file.landmarks3d[theirs, :2]) / size)
    assert np.isnan(distances).any()  # a profile hides one
    assert np.nanmedian(distances) < 0.03


def test_a_file_without_the_21_points_is_refused(shared_dir):
    path = next((shared_dir / "data/300wlp").glob("*.mat"))
    with pytest.raises(InputFileError, match="21 points"):
        read_aflw21_landmarks(path)


def test_the_21_points_are_counted_from_1_and_missing_ones_are_undefined(tmp_path: Path) -> None:
    stored = np.arange(42.0).reshape(2, 21) + 1
    stored[:, 3], stored[:, 7] = (-1, 452), (-1, -1)
    scipy.io.savemat(tmp_path / "face.mat", {"pt2d": stored})
    points = read_aflw21_landmarks(tmp_path / "face.mat")
    np.testing.assert_array_equal(points[0], [0.5, 21.5])
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(points).any(axis=1)), [3, 7])
