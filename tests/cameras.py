"""Weak-perspective cameras that look at a head from any side."""

import numpy as np

from pix2face.geometry.camera import Camera, HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera


def posed_camera(
    x: float, y: float, *, pitch_deg: float = 0, yaw_deg: float = 0, roll_deg: float = 0, scale: float = 1
) -> Camera:
    """A camera that sees the model's origin at a pixel, with the given pixels per millimetre."""
    rotation = rotation_of_pose(HeadPose(pitch_deg, yaw_deg, roll_deg))
    return weak_perspective_camera(WeakPerspective(scale, rotation, np.array([x, y], dtype=float)))
