"""Cameras in the forms of OpenCV, COLMAP and glTF.

All three project points of the model frame: OpenCV and COLMAP take them in mm, glTF in metres. They differ in where the
first pixel lies: its centre is (0, 0) in OpenCV and (0.5, 0.5) in COLMAP, as in this project. glTF knows no pixels; its
camera looks along -z, with y up, and its axis meets the middle of the picture.

OpenCV and COLMAP have no camera without perspective. A weak-perspective camera becomes a pinhole ``FAR_MM`` away, whose
axis goes through the model's origin: a point x mm beside the axis and z mm in front of the origin is seen
scale x z / FAR_MM pixels off, which is 0.01 pixels for a point 100 mm from either at 1 pixel per mm.
"""

import math
from typing import Any, Final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from pix2face.geometry.camera import (
    FRONTAL,
    Camera,
    Pinhole,
    WeakPerspective,
    nearest_weak_perspective,
    pinhole_of,
    weak_perspective_camera,
)

FAR_MM: Final = 1e6
M_PER_MM: Final = 1e-3
# glTF's camera without perspective stands so far from the model's origin, and sees twice as far.
ORTHOGRAPHIC_DISTANCE_MM: Final = 1000.0
NEAREST_SEEN_M: Final = 0.01


def camera_kind(camera: Camera) -> str:
    """What a matrix is: "pinhole", "weak-perspective" or "affine"."""
    if not camera.is_affine:
        return "pinhole"
    nearest = weak_perspective_camera(nearest_weak_perspective(camera)).matrix[:2]
    is_weak = np.abs(nearest - camera.matrix[:2]).max() <= 1e-6 * np.abs(camera.matrix[:2, :3]).max()
    return "weak-perspective" if is_weak else "affine"


def opencv_camera(camera: Camera) -> dict[str, Any] | None:
    """The arguments of ``cv2.projectPoints``: a pixel is K (R X + t), and the first one has its centre at (0, 0).

    None for an affine camera that is not weak-perspective.
    """
    if camera_kind(camera) == "affine":
        return None
    pinhole = _pinhole(camera)
    x, y = (pinhole.principal_point_px - 0.5).tolist()
    return {
        "camera_matrix": [[pinhole.focal_px, 0.0, x], [0.0, pinhole.focal_px, y], [0.0, 0.0, 1.0]],
        "rotation": pinhole.rotation.tolist(),
        "translation_mm": pinhole.translation_mm.tolist(),
    }


def colmap_camera(camera: Camera, size_px: tuple[int, int]) -> dict[str, Any] | None:
    """A line of COLMAP's ``cameras.txt``, and the pose of one of ``images.txt``; the first pixel's centre is at +0.5.

    None as for OpenCV. The size is (height, width).
    """
    if camera_kind(camera) == "affine":
        return None
    pinhole = _pinhole(camera)
    return {
        "model": "SIMPLE_PINHOLE",
        "width": size_px[1],
        "height": size_px[0],
        "params": [pinhole.focal_px, *pinhole.principal_point_px.tolist()],
        "qvec": np.roll(Rotation.from_matrix(pinhole.rotation).as_quat(), 1).tolist(),
        "tvec_mm": pinhole.translation_mm.tolist(),
    }


def gltf_camera(camera: Camera, size_px: tuple[int, int]) -> dict[str, Any] | None:
    """An entry of glTF's ``cameras``, and the ``matrix`` of its node in a scene of the model frame in metres.

    None for an affine camera that is not weak-perspective, and for a pinhole whose axis does not meet the middle of the
    picture, since glTF has neither. The size is (height, width).

    Source: glTF 2.0 specification, Sec. 3.10 (cameras look along -z, y is up; matrices are stored by columns).
    """
    height, width = size_px
    middle = np.array([width / 2, height / 2])
    kind = camera_kind(camera)
    if kind == "affine":
        return None
    if kind == "pinhole":
        pinhole = pinhole_of(camera)
        if np.abs(pinhole.principal_point_px - middle).max() > 0.01:
            return None
        field_of_view = 2 * math.atan(height / 2 / pinhole.focal_px)
        lens = {"yfov": field_of_view, "aspectRatio": width / height, "znear": NEAREST_SEEN_M}
        matrix = _node_matrix(pinhole.rotation, -pinhole.translation_mm)
        return {"camera": {"type": "perspective", "perspective": lens}, "matrix": matrix}
    weak = nearest_weak_perspective(camera)
    m_per_px = M_PER_MM / weak.scale
    sides = {"xmag": width / 2 * m_per_px, "ymag": height / 2 * m_per_px}
    depths = {"znear": NEAREST_SEEN_M, "zfar": 2 * ORTHOGRAPHIC_DISTANCE_MM * M_PER_MM}
    place = np.append((middle - weak.translation_px) / weak.scale, -ORTHOGRAPHIC_DISTANCE_MM)
    return {
        "camera": {"type": "orthographic", "orthographic": sides | depths},
        "matrix": _node_matrix(weak.rotation, place),
    }


def _pinhole(camera: Camera) -> Pinhole:
    """The camera itself, or the one that stands far away in its place."""
    return far_pinhole(nearest_weak_perspective(camera)) if camera.is_affine else pinhole_of(camera)


def far_pinhole(weak: WeakPerspective) -> Pinhole:
    """The pinhole ``FAR_MM`` away that sees the model almost as a weak-perspective camera does."""
    return Pinhole(weak.scale * FAR_MM, weak.translation_px, weak.rotation, np.array([0.0, 0.0, FAR_MM]))


def _node_matrix(rotation: Float64[ndarray, "3 3"], place_mm: Float64[ndarray, "3"]) -> list[float]:
    """World from camera, by columns; the place of the camera is in the turned frame, x right, y down, z forward."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation.T @ FRONTAL
    matrix[:3, 3] = rotation.T @ place_mm * M_PER_MM
    return np.asarray(matrix.T.ravel()).tolist()
