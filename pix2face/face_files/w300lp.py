"""Coefficient files of 300W-LP and AFLW2000-3D: one MAT 5 file for each picture (docs/reference/conventions.md)."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.mat_files import mat_names, read_mat
from pix2face.geometry.camera import (
    Camera,
    HeadPose,
    WeakPerspective,
    nearest_weak_perspective,
    published_pose,
    rotation_of_pose,
    weak_perspective_camera,
)
from pix2face.geometry.landmarks import N_IBUG68, ONE_BASED_TO_CENTRES_PX, mark_missing

N_IDENTITY = 199
N_EXPRESSION = 29
N_LIGHTING = 10
# Files of this kind hold some 10 KB; a file far beyond that is something else and is not read.
LARGEST_FILE_BYTES = 4 << 20

_LENGTHS = {
    "Shape_Para": N_IDENTITY,
    "Exp_Para": N_EXPRESSION,
    "Pose_Para": 7,
    "Illum_Para": N_LIGHTING,
}
# The mean of the 68 landmarks of BFM 2009's mean face.
LANDMARK_CENTRE_MM = np.array([0.0, -11.8, 89.8])
# Beyond this the annotation of AFLW2000-3D is known to be unreliable.
USUAL_ANGLE_DEG = 99.0
# The share of the face's size, see `check_picture_height`; a height that is wrong by 6 % is off by this much.
LARGEST_HEIGHT_ERROR = 0.15
# How many coordinates the points of a field have.
_POINTS = {"pt2d": 2, "pt3d_68": 3}


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class PoseParameters:
    """``Pose_Para``: V = f R S + t in the authors' frame (x right, y up, z towards the viewer, pixels)."""

    head: HeadPose  # pitch, yaw and roll as they stand in the file (they may exceed ±180°)
    translation_px: Float64[ndarray, "3"]
    scale: float  # f, pixels per µm; negative in a few files of AFLW2000-3D

    @property
    def is_unusual(self) -> bool:
        """Whether an angle is beyond ±99°."""
        return max(abs(self.head.pitch_deg), abs(self.head.yaw_deg), abs(self.head.roll_deg)) > USUAL_ANGLE_DEG


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class CoefficientFile:
    """The content of a ``.mat`` file, cast to float64 and otherwise unchanged."""

    path: Path
    identity: Float64[ndarray, "199"]  # ``Shape_Para``, in the units of BFM 2009's basis (not standard deviations)
    expression: Float64[ndarray, "29"]  # ``Exp_Para``, likewise
    pose: PoseParameters
    # ``pt2d`` where it has 68 points, in the project's pixels, else None. They belong to the source photograph: right
    # only for the copy ``_0``.
    landmarks2d: Float64[ndarray, "68 2"] | None
    # ``pt3d_68`` in the project's pixels (u, v) with depth (pixels, larger is farther), or None. Where the scale is
    # negative the face of the file is inside out; the depth here is that of the face the right side out, as in
    # ``camera_of_pose``.
    landmarks3d: Float64[ndarray, "68 3"] | None
    lighting: Float64[ndarray, "10"] | None  # ``Illum_Para``


def read_coefficient_file(path: Path) -> CoefficientFile:
    """Reads a ``.mat`` file of 300W-LP or AFLW2000-3D.

    Raises:
        InputFileError: Missing, truncated or foreign file; wrong counts; values that are not finite.
    """
    fields = read_mat(path, (*_LENGTHS, *_POINTS), LARGEST_FILE_BYTES)
    missing = [name for name in ("Shape_Para", "Exp_Para", "Pose_Para") if name not in fields]
    if missing:
        raise InputFileError(
            f"{path}: expected a coefficient file of 300W-LP or AFLW2000-3D, missing are {', '.join(missing)}; "
            f"found {', '.join(mat_names(path)) or 'nothing'} in it"
        )
    if "pt2d" in fields and fields["pt2d"].shape not in ((2, 68), (68, 2)):
        del fields["pt2d"]  # AFLW2000-3D has 21 points there, with -1 for missing ones
    points = {name: _rows_of(path, name, fields.pop(name), n) for name, n in _POINTS.items() if name in fields}
    points2d, points3d = points.get("pt2d"), points.get("pt3d_68")
    numbers = _numbers(path, fields)
    pose = numbers["Pose_Para"]
    if pose[6] == 0:
        raise InputFileError(f"{path}: expected a scale in Pose_Para, found 0")
    towards_viewer = math.copysign(1, pose[6])
    return CoefficientFile(
        path=path,
        identity=numbers["Shape_Para"],
        expression=numbers["Exp_Para"],
        pose=PoseParameters(
            head=HeadPose(*np.degrees(pose[:3]).tolist()), translation_px=pose[3:6], scale=float(pose[6])
        ),
        landmarks2d=None if points2d is None else points2d + ONE_BASED_TO_CENTRES_PX,
        landmarks3d=None if points3d is None else points3d * [1, 1, -towards_viewer] - [0.5, 0.5, 0],
        lighting=numbers.get("Illum_Para"),
    )


def read_landmark_file(path: Path) -> Float64[ndarray, "68 2"]:
    """Reads the landmarks of one picture from 300W-LP's ``landmarks/`` folder, in the project's pixels.

    ``pts_3d``, the projections of the model's own landmarks, where the file has it; else ``pts_2d``, whose jaw follows
    the visible outline. NaN where a point is missing.

    Raises:
        InputFileError: Missing, truncated or foreign file; wrong counts.
    """
    fields = read_mat(path, ("pts_3d", "pts_2d"), LARGEST_FILE_BYTES)
    name = next((name for name in ("pts_3d", "pts_2d") if name in fields), None)
    if name is None:
        raise InputFileError(f"{path}: expected pts_3d or pts_2d of 300W-LP's landmarks folder, found neither")
    return _rows_of(path, name, fields[name], 2) + ONE_BASED_TO_CENTRES_PX


def read_aflw21_landmarks(path: Path) -> Float64[ndarray, "21 2"]:
    """Reads the 21 points of AFLW that files of AFLW2000-3D hold as ``pt2d``, in the project's pixels.

    They are points set by hand where they are visible. Missing ones stand in the files as (-1, 452) or (-1, -1) and are
    NaN here: 452 is H + 1 - (-1), so these points went through the same turn of the y axis as all else in these files,
    and are counted from 1 like it.

    Raises:
        InputFileError: Missing, truncated or foreign file; other counts; values that are not finite.
    """
    points = read_mat(path, ("pt2d",), LARGEST_FILE_BYTES).get("pt2d")
    if points is None or points.shape != (2, 21):
        found = "none" if points is None else f"an array of {' x '.join(map(str, points.shape))}"
        raise InputFileError(f"{path}: expected pt2d with 21 points (AFLW2000-3D), found {found}")
    points = points.T.astype(np.float64)
    if not np.isfinite(points).all():
        raise InputFileError(f"{path}: expected finite numbers in pt2d, found NaN or infinity")
    missing = points[:, :1] < 0
    return np.where(missing, np.nan, points + ONE_BASED_TO_CENTRES_PX)


def check_picture_height(file: CoefficientFile, image_height_px: int) -> None:
    """Checks that a file belongs to a picture of this height, which its pose refers to and its landmarks do not.

    The middle of the landmarks and that of the mean face's landmarks, posed by the file, lie on one height. Of 403
    files of AFLW2000-3D and 300W-LP, the worst differs by 4 % of the face's size.

    Raises:
        InputFileError: They lie apart. Nothing is checked where the file has no landmarks of its picture.
    """
    is_source = re.search(r"_[1-9]\d*$", file.path.stem) is None
    points = file.landmarks3d if file.landmarks3d is not None else file.landmarks2d if is_source else None
    size_px = 0.0 if points is None else float(np.sqrt(np.prod(np.ptp(points[:, :2], axis=0))))
    if points is None or not size_px > 0:  # none, some missing, or no face at all
        return
    expected = camera_of_pose(file.pose, image_height_px).project(LANDMARK_CENTRE_MM)[1]
    off = float(expected - points[:, 1].mean()) / size_px
    if not abs(off) <= LARGEST_HEIGHT_ERROR:
        raise InputFileError(
            f"{file.path}: expected its landmarks where its pose puts the face in a picture of {image_height_px} "
            f"pixels height, found them {abs(100 * off):.0f} % of the face's size away; was the picture resized or "
            "cropped after annotation?"
        )


def camera_of_pose(pose: PoseParameters, image_height_px: int) -> Camera:
    """The camera that ``Pose_Para`` describes, for model points in mm.

    A negative scale would turn the face inside out; the camera returned gives the same pixels with a positive one
    (-f R and f diag(-1, -1, 1) R agree in x and y), so that nearer points stay nearer. The height of the picture is
    needed since the file's y axis points up from its lower edge.
    """
    rotation = rotation_of_pose(pose.head)
    if pose.scale < 0:
        rotation = np.diag([-1.0, -1.0, 1.0]) @ rotation
    # V is in the authors' 1-based frame; 0-based, with centres at integers: u = V_x - 1, v = H - V_y. Ours: + 0.5.
    translation = np.array([pose.translation_px[0] - 0.5, image_height_px - pose.translation_px[1] + 0.5])
    return weak_perspective_camera(WeakPerspective(abs(pose.scale) * 1000, rotation, translation))


def pose_of_camera(camera: Camera, image_height_px: int) -> PoseParameters:
    """``Pose_Para`` of a camera: the inverse of ``camera_of_pose``, for what 300W-LP's tools read.

    Of a pinhole, or an affine camera that is not weak perspective, the nearest weak perspective. The depth translation
    tz, which no picture tells, is 0.
    """
    parameters = nearest_weak_perspective(camera)
    tx, ty = parameters.translation_px
    translation = np.array([tx + 0.5, image_height_px - ty + 0.5, 0.0])
    return PoseParameters(head=published_pose(camera), translation_px=translation, scale=parameters.scale / 1000)


def _rows_of(path: Path, name: str, values: ndarray, n_columns: int) -> Float64[ndarray, "68 d"]:
    """68 points, one a row, from an array that has them as rows or as columns; NaN where a point is missing.

    Raises:
        InputFileError: The array has another shape, which could be read in more than one way.
    """
    if values.shape == (n_columns, N_IBUG68):
        values = values.T
    if values.shape != (N_IBUG68, n_columns):
        shapes = f"({n_columns}, {N_IBUG68}) or ({N_IBUG68}, {n_columns})"
        raise InputFileError(f"{path}: expected {name} of shape {shapes}, found {values.shape}")
    return mark_missing(values.astype(np.float64))


def _numbers(path: Path, fields: Mapping[str, ndarray]) -> dict[str, Float64[ndarray, " _"]]:
    """Casts the fields and flattens them row by row."""
    numbers = {name: values.ravel().astype(np.float64) for name, values in fields.items()}
    for name, values in numbers.items():
        if len(values) != _LENGTHS[name]:
            raise InputFileError(f"{path}: expected {_LENGTHS[name]} numbers in {name}, found {len(values)}")
    bad = ", ".join(name for name, values in numbers.items() if not np.isfinite(values).all())
    if bad:
        raise InputFileError(f"{path}: expected finite numbers in {bad}, found NaN or infinity")
    return numbers
