"""Two samples of 300W-LP against what an independent program computed for them.

Its points are (V_x, H - V_y) of the authors' frame, so (+0.5, -0.5) px from ours. It keeps 40 and 10 coefficients, and
its landmarks are vertices of a mesh of its own.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from numpy import ndarray
from scipy.spatial.transform import Rotation

from pix2face.face_files.w300lp import CoefficientFile, camera_of_pose, read_coefficient_file
from pix2face.geometry.camera import Camera
from tests.keypoint_model import KeypointModel, unposed_mm

HEIGHT_PX = 450
PIXELS_FROM_OURS = np.array([0.5, -0.5])
FRAME_FROM_MODEL = np.diag([1.0, -1.0, -1.0])  # y down, z into the picture
# It calls half the picture's width by 224 times 100 mm the size of a head, and gives a point between the eyes.
HEAD_MM = 0.5 * 450 / 224 * 100
BETWEEN_EYES_MM = np.array([0, 0.26, 0.9]) * HEAD_MM


@dataclass(frozen=True)
class Reference:
    """A file as we read it, and what the other program says about it."""

    file: CoefficientFile
    rotation: Rotation
    centre_px: ndarray
    size_px: float
    points_px: ndarray
    coefficients: ndarray

    @property
    def camera(self) -> Camera:
        return camera_of_pose(self.file.pose, HEIGHT_PX)


@pytest.fixture(scope="module")
def references(shared_dir: Path) -> list[Reference]:
    return list(read_references(shared_dir / "data" / "300wlp_afw"))


def read_references(folder: Path) -> Iterator[Reference]:
    with h5py.File(folder / "reference_output.h5") as stored:
        for row in stored["sequence_starts"][:-1]:
            (path,) = folder.glob(f"300W_LP/*/{stored['images'].asstr()[row].removesuffix('0.jpg')}.mat")
            yield Reference(
                read_coefficient_file(path),
                Rotation.from_quat(stored["quats"][row]),
                stored["coords"][row, :2] - PIXELS_FROM_OURS,
                float(stored["coords"][row, 2]),
                stored["pt3d_68"][row] - np.append(PIXELS_FROM_OURS, 0),
                stored["shapeparams"][row],
            )


def test_pose_scale_and_coefficients_are_the_same(references: list[Reference]) -> None:
    assert len(references) == 2
    for own in references:
        scale = np.linalg.norm(own.camera.matrix[0, :3])
        rotation = own.camera.matrix[:3, :3] / [[scale], [scale], [1]] @ FRAME_FROM_MODEL
        assert np.degrees((Rotation.from_matrix(rotation).inv() * own.rotation).magnitude()) < 1e-4
        assert scale * HEAD_MM == pytest.approx(own.size_px, rel=1e-6)
        ours = np.concatenate([own.file.identity[:40] / 2e6, own.file.expression[:10] / 5])
        np.testing.assert_allclose(ours, own.coefficients, rtol=1e-6)


def test_a_point_between_the_eyes_is_at_the_same_pixel(references: list[Reference]) -> None:
    for own in references:
        np.testing.assert_allclose(own.camera.project(BETWEEN_EYES_MM[None])[0], own.centre_px, atol=1e-3)


def shortened(file: CoefficientFile) -> CoefficientFile:
    """With the coefficients that the other program uses."""
    return replace(
        file,
        identity=np.where(np.arange(199) < 40, file.identity, 0),
        expression=np.where(np.arange(29) < 10, file.expression, 0),
    )


def test_the_68_points_agree_as_far_as_the_landmarks_are_the_same_vertices(
    references: list[Reference], keypoints: KeypointModel
) -> None:
    differences_mm = []
    for own in references:
        ours_mm = keypoints.keypoints_mm(shortened(own.file))
        distances = np.linalg.norm(own.camera.project(ours_mm) - own.points_px[:, :2], axis=1)
        assert np.median(distances) < 0.4
        assert distances.max() < 4
        theirs_mm = unposed_mm(replace(own.file, landmarks3d=own.points_px), HEIGHT_PX)
        differences_mm.append((theirs_mm - ours_mm) - (theirs_mm - ours_mm).mean(axis=0))
    # Other vertices are as far away in one face as in the other. Only at the corners of the eyes do they move apart.
    first, second = differences_mm
    assert np.sqrt(((first - second) ** 2).sum(axis=1).mean()) < 0.12
    assert np.median(np.linalg.norm(first - second, axis=1)) < 0.05
