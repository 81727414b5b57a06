"""Coefficient files of 300W-LP and AFLW2000-3D: one MAT 5 file for each picture (docs/conventions.md)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
import scipy.io
from jaxtyping import Float, Float64
from numpy import ndarray

from pix2face.camera import FRONTAL, Camera, HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.errors import InputFileError

N_IDENTITY = 199
N_EXPRESSION = 29
# Files of this kind hold some 10 KB; a file far beyond that is something else and is not opened.
LARGEST_FILE_BYTES = 4 << 20


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class PoseParameters:
    """``Pose_Para``: V = f R S + t in the authors' frame (x right, y up, z towards the viewer, pixels).

    Attributes:
        head: Pitch, yaw and roll as they stand in the file (they may exceed ±180°).
        translation_px: tx, ty, tz.
        scale: f, pixels per µm. Negative in a few files of AFLW2000-3D.
    """

    head: HeadPose
    translation_px: Float64[ndarray, "3"]
    scale: float


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class CoefficientFile:
    """What a ``.mat`` file says, cast to float64 and otherwise untouched.

    Attributes:
        path: The file.
        identity: ``Shape_Para``, in the units of BFM 2009's stored basis (not standard deviations).
        expression: ``Exp_Para``, likewise.
        pose: ``Pose_Para``.
        landmarks2d: ``pt2d`` where it has 68 points, in the project's pixels, else None. They belong to the source
            photograph: right only for the copy ``_0``.
        landmarks3d: ``pt3d_68`` in the project's pixels (u, v) with depth (pixels, larger is farther), or None. Where
            the scale is negative the face of the file is inside out; the depth here is that of the face the right
            side out, as in ``camera_of_pose``.
    """

    path: Path
    identity: Float64[ndarray, "199"]
    expression: Float64[ndarray, "29"]
    pose: PoseParameters
    landmarks2d: Float64[ndarray, "68 2"] | None
    landmarks3d: Float64[ndarray, "68 3"] | None


def read_coefficient_file(path: Path) -> CoefficientFile:
    """Reads a ``.mat`` file of 300W-LP or AFLW2000-3D.

    Raises:
        InputFileError: Missing, truncated or foreign file; wrong counts; values that are not finite.
    """
    fields = read_mat(path, ("Shape_Para", "Exp_Para", "Pose_Para", "pt2d", "pt3d_68"))
    missing = [name for name in ("Shape_Para", "Exp_Para", "Pose_Para") if name not in fields]
    if missing:
        found = ", ".join(name for name, _, _ in scipy.io.whosmat(path)) or "nothing"
        raise InputFileError(
            f"{path}: expected a coefficient file of 300W-LP or AFLW2000-3D, missing are {', '.join(missing)}; "
            f"found {found} in it"
        )
    pose = _numbers(path, fields, "Pose_Para", 7)
    return CoefficientFile(
        path=path,
        identity=_numbers(path, fields, "Shape_Para", N_IDENTITY),
        expression=_numbers(path, fields, "Exp_Para", N_EXPRESSION),
        pose=PoseParameters(
            head=HeadPose(*(float(angle) for angle in np.degrees(pose[:3]))),
            translation_px=pose[3:6],
            scale=float(pose[6]),
        ),
        landmarks2d=_landmarks2d(path, fields),
        landmarks3d=_landmarks3d(path, fields, towards_viewer=float(np.sign(pose[6]))),
    )


def read_landmark_file(path: Path) -> Float64[ndarray, "68 2"]:
    """Reads the landmarks of one picture from 300W-LP's ``landmarks/`` folder, in the project's pixels.

    ``pts_3d``, the projections of the model's own landmarks, where the file has it; else ``pts_2d``, whose jaw follows
    the visible outline.

    Raises:
        InputFileError: Missing, truncated or foreign file; wrong counts; values that are not finite.
    """
    fields = read_mat(path, ("pts_3d", "pts_2d"))
    name = next((name for name in ("pts_3d", "pts_2d") if name in fields), None)
    if name is None:
        raise InputFileError(f"{path}: expected pts_3d or pts_2d of 300W-LP's landmarks folder, found neither")
    if np.shape(fields[name]) != (68, 2):
        raise InputFileError(f"{path}: expected {name} of shape (68, 2), found {np.shape(fields[name])}")
    return matlab_to_pixels(_numbers(path, fields, name, 136).reshape(68, 2))


def camera_of_pose(pose: PoseParameters, image_height_px: int) -> Camera:
    """The camera that ``Pose_Para`` describes, for model points in mm.

    A negative scale would turn the face inside out; the camera returned gives the same pixels with a positive one
    (-f R and f diag(-1, -1, 1) R agree in x and y), so that nearer points stay nearer.

    Args:
        pose: From the file.
        image_height_px: Height of the picture: the file's y axis points up from its lower edge.
    """
    rotation = rotation_of_pose(pose.head)
    if pose.scale < 0:
        rotation = np.diag([-1.0, -1.0, 1.0]) @ rotation
    # V is in the authors' 1-based frame; 0-based, with centres at integers: u = V_x - 1, v = H - V_y. Ours: + 0.5.
    translation = np.array([pose.translation_px[0] - 0.5, image_height_px - pose.translation_px[1] + 0.5])
    return weak_perspective_camera(WeakPerspective(abs(pose.scale) * 1000, rotation, translation))


def points_of_pose(
    points_um: Float[ndarray, "n 3"], pose: PoseParameters, image_height_px: int
) -> Float64[ndarray, "n 3"]:
    """Model points (µm) posed as the authors do, in their own 1-based frame: exactly what ``pt3d_68`` holds."""
    rotated = points_um @ (FRONTAL @ rotation_of_pose(pose.head)).T
    posed = pose.scale * rotated + pose.translation_px
    posed[:, 1] = image_height_px + 1 - posed[:, 1]
    return np.asarray(posed, dtype=np.float64)


def matlab_to_pixels(points: Float64[ndarray, "n 2"]) -> Float64[ndarray, "n 2"]:
    """1-based coordinates with integer centres to the project's pixels (centres at +0.5)."""
    return points - 0.5


def read_mat(path: Path, names: tuple[str, ...]) -> dict[str, Any]:
    """Reads named variables of a small MAT 5 file; those that it lacks are left out.

    Raises:
        InputFileError: The file is missing, too large, truncated, or no MAT 5 file.
    """
    try:
        size = path.stat().st_size
    except OSError as error:
        raise InputFileError(f"{path}: no such file") from error
    if size > LARGEST_FILE_BYTES:
        raise InputFileError(f"{path}: expected a coefficient file of some 10 KB, found {size >> 20} MB")
    try:
        fields: dict[str, Any] = scipy.io.loadmat(
            path, variable_names=list(names), verify_compressed_data_integrity=True
        )
    except Exception as error:
        raise InputFileError(
            f"{path}: expected a MAT 5 file, found one that cannot be read ({type(error).__name__}: {error})"
        ) from error
    return {name: fields[name] for name in names if name in fields}


def _numbers(path: Path, fields: dict[str, Any], name: str, n: int) -> Float64[ndarray, " n"]:
    try:
        values = np.asarray(fields[name], dtype=np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise InputFileError(f"{path}: expected {n} numbers in {name}, found {type(fields[name]).__name__}") from error
    if len(values) != n:
        raise InputFileError(f"{path}: expected {n} numbers in {name}, found {len(values)}")
    if not np.isfinite(values).all():
        raise InputFileError(f"{path}: expected finite numbers in {name}, found NaN or infinity")
    return values


def _landmarks2d(path: Path, fields: dict[str, Any]) -> Float64[ndarray, "68 2"] | None:
    if "pt2d" not in fields or np.shape(fields["pt2d"]) != (2, 68):
        return None
    return matlab_to_pixels(_numbers(path, fields, "pt2d", 136).reshape(2, 68).T)


def _landmarks3d(path: Path, fields: dict[str, Any], towards_viewer: float) -> Float64[ndarray, "68 3"] | None:
    if "pt3d_68" not in fields:
        return None
    points = _numbers(path, fields, "pt3d_68", 204).reshape(3, 68).T
    return np.column_stack([matlab_to_pixels(points[:, :2]), -towards_viewer * points[:, 2]])
