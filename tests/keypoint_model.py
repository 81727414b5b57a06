"""The 68 keypoints' own linear model of BFM 2009, from the files of AFLW2000-3D alone.

``pt3d_68`` with its pose undone is linear in the coefficients; a regression over the 400 files yields mean and bases of
the keypoints in µm (docs/reference/conventions.md). It tells where the landmarks of a file lie in any other pose.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy import ndarray

from pix2face.face_files.w300lp import CoefficientFile, PoseParameters, camera_of_pose, read_coefficient_file
from pix2face.geometry.camera import FRONTAL, rotation_of_pose


@dataclass(frozen=True)
class KeypointModel:
    """Keypoints in mm, linear in [1, Shape_Para, Exp_Para]."""

    weights: ndarray
    scale: ndarray

    def keypoints_mm(self, file: CoefficientFile) -> ndarray:
        """The (68, 3) keypoints of a file's coefficients, in BFM's frame."""
        return (design_row(file) / self.scale @ self.weights).reshape(68, 3)


def design_row(file: CoefficientFile) -> ndarray:
    """1 and the coefficients."""
    return np.concatenate([[1], file.identity, file.expression])


def unposed_mm(file: CoefficientFile, height_px: int = 450) -> ndarray:
    """``pt3d_68`` in BFM's frame."""
    assert file.landmarks3d is not None
    camera = camera_of_pose(file.pose, height_px)
    scale = float(np.linalg.norm(camera.matrix[0, :3]))
    depth = file.landmarks3d[:, 2] + file.pose.translation_px[2]
    target = np.column_stack([file.landmarks3d[:, :2], depth])
    matrix = np.vstack([camera.matrix[:2], scale * camera.matrix[2]])
    return np.linalg.solve(matrix[:, :3], (target - matrix[:, 3]).T).T


def fit_keypoint_model(folder: Path) -> KeypointModel:
    """Regresses the model from a folder of AFLW2000-3D files."""
    return fit_keypoint_model_to([read_coefficient_file(path) for path in sorted(folder.glob("*.mat"))])


def fit_keypoint_model_to(files: Sequence[CoefficientFile]) -> KeypointModel:
    """Regresses the model from files with ``pt3d_68``."""
    design = np.stack([design_row(file) for file in files])
    scale = np.abs(design).max(axis=0)
    targets = np.stack([unposed_mm(file).ravel() for file in files])
    return KeypointModel(np.linalg.lstsq(design / scale, targets, rcond=None)[0], scale)


def points_of_pose(points_um: ndarray, pose: PoseParameters, image_height_px: int) -> ndarray:
    """Model points (µm) posed as the authors do, in their own 1-based frame: exactly what ``pt3d_68`` holds."""
    rotated = points_um @ (FRONTAL @ rotation_of_pose(pose.head)).T
    posed = pose.scale * rotated + pose.translation_px
    posed[:, 1] = image_height_px + 1 - posed[:, 1]
    return np.asarray(posed, dtype=np.float64)
