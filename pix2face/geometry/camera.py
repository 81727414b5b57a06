"""Cameras: one 4x4 matrix for the affine, the weak-perspective and the pinhole model, and exact conversions.

A camera maps a model point (x, y, z, 1) in mm to (u w, v w, depth, w): (u, v) is the pixel (x right, y down, centres at
+0.5), depth is in mm and grows with distance. An affine camera has w = 1 and depth relative to the model's origin; a
pinhole has w = depth. One matrix serves renderer, shards and fitter alike; a crop only changes its first two rows.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float, Float64
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError

# Camera space has y down and z forward, model space y up and z out of the face: a frontal face is turned by this.
FRONTAL = np.diag([1.0, -1.0, -1.0])
# Cosine of a yaw so near to 90 degrees that pitch and roll cannot be told apart.
GIMBAL_LOCK = 1e-9


@final
@dataclass(frozen=True, eq=False)
class Camera:
    """A projection from the model frame (mm) to an image (px) with depth (mm)."""

    matrix: Float64[ndarray, "4 4"]  #: maps a model point (x, y, z, 1) to (u w, v w, depth, w)

    @property
    def is_affine(self) -> bool:
        """Whether the camera has no perspective."""
        return bool(self.matrix[3].tolist() == [0, 0, 0, 1])

    def project(self, points: Float[ndarray, "*n 3"]) -> Float64[ndarray, "*n 2"]:
        """Projects model points (mm) to pixels."""
        homogeneous = points @ self.matrix[[0, 1, 3], :3].T + self.matrix[[0, 1, 3], 3]
        return np.asarray(homogeneous[..., :2] / homogeneous[..., 2:], dtype=np.float64)

    def depth(self, points: Float[ndarray, "*n 3"]) -> Float64[ndarray, "*n"]:
        """Depth of model points in mm, larger is farther (affine: relative to the model's origin)."""
        return np.asarray(points @ self.matrix[2, :3] + self.matrix[2, 3], dtype=np.float64)

    @cached_property
    def _nearest_weak_perspective(self) -> "WeakPerspective":
        """Computed once for the checks and poses of a face, which share its arrays: they cannot be written to."""
        affine = linearised(self).matrix
        u, singular_values, vt = np.linalg.svd(affine[:2, :3], full_matrices=False)
        rows = u @ vt
        third = rows[0, [1, 2, 0]] * rows[1, [2, 0, 1]] - rows[0, [2, 0, 1]] * rows[1, [1, 2, 0]]  # the cross product
        rotation = np.stack([rows[0], rows[1], third])
        translation = affine[:2, 3].copy()
        rotation.flags.writeable = translation.flags.writeable = False
        return WeakPerspective(float(singular_values.mean()), rotation, translation)

    def transformed(self, image_from_image: Float[ndarray, "3 3"]) -> "Camera":
        """The camera of a picture that was cropped, scaled or turned by an affine map of pixels."""
        matrix = self.matrix.copy()
        matrix[:2] = image_from_image[:2, :2] @ self.matrix[:2] + np.outer(image_from_image[:2, 2], self.matrix[3])
        return Camera(matrix)


@final
@dataclass(frozen=True, eq=False)
class WeakPerspective:
    """Parameters of a scaled orthographic camera: pixel = scale * (rotation @ x)[:2] + translation_px."""

    scale: float  #: pixels per mm, positive
    rotation: Float64[ndarray, "3 3"]  #: camera_from_model, determinant +1
    translation_px: Float64[ndarray, "2"]  #: image of the model's origin


@final
@dataclass(frozen=True, eq=False)
class Pinhole:
    """Parameters of a pinhole with square pixels and no skew."""

    focal_px: float  #: focal length
    principal_point_px: Float64[ndarray, "2"]  #: where the optical axis meets the image
    rotation: Float64[ndarray, "3 3"]  #: camera_from_model, determinant +1
    translation_mm: Float64[ndarray, "3"]  #: the model's origin in camera space


@final
@dataclass(frozen=True)
class HeadPose:
    """Rotation of the head as 300W-LP writes it; zero is frontal and upright."""

    pitch_deg: float  #: positive looks up
    yaw_deg: float  #: positive turns the face to the image's left (towards the subject's right shoulder)
    roll_deg: float  #: positive tilts the top of the head to the image's right, which is clockwise as seen


def affine_camera(a: Float[ndarray, "2 4"]) -> Camera:
    """The camera of an affine projection matrix (Eq. 1). Depth is along the direction perpendicular to both rows.

    Raises:
        DegenerateGeometryError: The rows are parallel.
    """
    (ax, ay, az), (bx, by, bz) = a[0, :3].tolist(), a[1, :3].tolist()
    axis = np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
    length = math.sqrt(axis @ axis)
    if not length > 0:
        raise DegenerateGeometryError("an affine camera needs two independent rows, found parallel ones")
    matrix = np.zeros((4, 4))
    matrix[:2], matrix[2, :3], matrix[3, 3] = a, axis / length, 1
    return Camera(matrix)


def weak_perspective_camera(parameters: WeakPerspective) -> Camera:
    """The camera of scaled orthographic parameters."""
    matrix = np.zeros((4, 4))
    matrix[:2, :3] = parameters.scale * parameters.rotation[:2]
    matrix[:2, 3] = parameters.translation_px
    matrix[2, :3] = parameters.rotation[2]
    matrix[3, 3] = 1
    return Camera(matrix)


def pinhole_camera(parameters: Pinhole) -> Camera:
    """The camera of pinhole parameters."""
    extrinsic = np.column_stack([parameters.rotation, parameters.translation_mm])
    matrix = np.zeros((4, 4))
    matrix[:2] = parameters.focal_px * extrinsic[:2] + np.outer(parameters.principal_point_px, extrinsic[2])
    matrix[2] = matrix[3] = extrinsic[2]
    return Camera(matrix)


def nearest_weak_perspective(camera: Camera) -> WeakPerspective:
    """The scaled orthographic camera nearest to an affine one (exact if it is one); a pinhole is linearised first.

    The 2x3 part is replaced by the nearest matrix with orthogonal rows of equal length (Frobenius norm). The arrays
    cannot be written to.
    """
    return camera._nearest_weak_perspective


def pinhole_of(camera: Camera) -> Pinhole:
    """Parameters of a pinhole camera: the inverse of ``pinhole_camera``, for square pixels without skew.

    Raises:
        DegenerateGeometryError: The camera is affine.
    """
    if camera.is_affine:
        raise DegenerateGeometryError("expected a pinhole camera, found an affine one")
    matrix = camera.matrix[[0, 1, 3]] / np.linalg.norm(camera.matrix[3, :3])
    principal_point = matrix[:2, :3] @ matrix[2, :3]
    scaled = matrix[:2] - np.outer(principal_point, matrix[2])
    focal = float(np.linalg.norm(scaled[:, :3]) / np.sqrt(2))
    u, _, vt = np.linalg.svd(np.vstack([scaled[:, :3] / focal, matrix[2, :3]]))
    translation = np.append(scaled[:, 3] / focal, matrix[2, 3])
    return Pinhole(focal, principal_point, u @ vt, translation)


def linearised(camera: Camera) -> Camera:
    """The affine camera that agrees with a camera to first order at the model's origin."""
    if camera.is_affine:
        return camera
    rows, offsets, w = camera.matrix[:2, :3], camera.matrix[:2, 3], camera.matrix[3, 3]
    centre = offsets / w
    jacobian = (rows - np.outer(centre, camera.matrix[3, :3])) / w
    return affine_camera(np.column_stack([jacobian, centre]))


def head_pose(camera: Camera) -> HeadPose:
    """Pitch, yaw and roll of the head in the camera (docs/reference/conventions.md).

    Pitch is within ±90° and yaw within ±180°, so yaw also says how far a head is turned beyond a profile.
    """
    return unfolded(published_pose(camera))


def unfolded(pose: HeadPose) -> HeadPose:
    """The angles of the same rotation whose pitch is within ±90°: R(p, y, r) = R(p ± 180°, 180° - y, r ± 180°)."""
    if abs(pose.pitch_deg) <= 90:
        return pose

    def half_a_turn(angle_deg: float) -> float:
        return angle_deg - math.copysign(180, angle_deg)

    yaw_deg = math.copysign(180, pose.yaw_deg) - pose.yaw_deg
    return HeadPose(half_a_turn(pose.pitch_deg), yaw_deg, half_a_turn(pose.roll_deg))


def published_pose(camera: Camera) -> HeadPose:
    """The same rotation as files of 300W-LP state it: yaw is within ±90°; beyond it, pitch and roll jump by 180°."""
    # R = Rx Ry Rz of the negated angles; by hand, since the general way takes longer than all else about landmarks.
    r = (FRONTAL @ nearest_weak_perspective(camera).rotation).tolist()
    cos_yaw = math.hypot(r[0][0], r[0][1])
    if cos_yaw > GIMBAL_LOCK:
        pitch, roll = math.atan2(r[1][2], r[2][2]), math.atan2(r[0][1], r[0][0])
    else:  # seen exactly from the side, pitch and roll are one angle
        pitch, roll = -math.atan2(r[2][1], r[1][1]), 0.0
    yaw = -math.atan2(r[0][2], cos_yaw)
    return HeadPose(math.degrees(pitch), math.degrees(yaw), math.degrees(roll))


def angle_between_poses_deg(a: HeadPose, b: HeadPose) -> float:
    """The angle of the rotation that turns one head into the other, 0 to 180.

    Unlike differences of pitch, yaw and roll, it means the same for every head. Near a profile, pitch and roll turn
    about almost the same axis, so both may be far off although the rotation is nearly right.
    """
    cosine = (np.trace(rotation_of_pose(a).T @ rotation_of_pose(b)) - 1) / 2
    return math.degrees(math.acos(min(max(float(cosine), -1.0), 1.0)))


def rotation_of_pose(pose: HeadPose) -> Float64[ndarray, "3 3"]:
    """The camera_from_model rotation of a head pose: R = Rx Ry Rz with 300W-LP's signs, then y down, z forward."""
    angles = [-pose.pitch_deg, -pose.yaw_deg, -pose.roll_deg]
    a, b, c = (math.radians(angle) for angle in angles)
    (ca, sa), (cb, sb), (cc, sc) = ((math.cos(angle), math.sin(angle)) for angle in (a, b, c))
    turn = [  # Rx(a) Ry(b) Rz(c), by hand as in ``head_pose``
        [cb * cc, -cb * sc, sb],
        [ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb],
        [sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb],
    ]
    return np.asarray(FRONTAL @ np.array(turn), dtype=np.float64)
