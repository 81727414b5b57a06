"""Draws poses, cameras and crops of faces.

Most pictures of a face are parts of a larger photograph, so the optical axis misses the face, and the principal point
is often outside the picture. The drawn pose is relative to the ray from the camera to the head, not to the optical
axis.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from datagen.sampling.sampling_config import GeometryConfig
from pix2face.geometry.camera import Camera, HeadPose, Pinhole, pinhole_camera, pinhole_of, rotation_of_pose
from pix2face.geometry.crops import FaceBox

# Samples with this attribute also have the other attributes of the camera.
FOCAL_LENGTH = "focal_px"


@final
@dataclass(frozen=True)
class PhotographedView:
    """Pose, distance and framing of a face in a photograph."""

    pose: HeadPose  # relative to the ray from the camera to the head, before the picture is turned
    turn_deg: float  # clockwise rotation of the whole picture, as of people who lie down
    distance_mm: float  # from the camera to the centre of the landmarks
    off_axis_deg: tuple[float, float]  # angle between that ray and the optical axis, to the right and downward
    picture_per_box: float  # side of the picture as a multiple of the longer side of the landmarks' box
    shift: tuple[float, float]  # picture centre relative to box centre, (right, down), as a share of the longer side


def draw_photographed_view(rng: np.random.Generator, config: GeometryConfig) -> PhotographedView:
    """Draws pose, distance and framing."""
    roll = float(_cut_normal(rng, config.roll_deg, 90, 1)[0])
    pose = HeadPose(_draw_pitch(rng, config), _draw_yaw(rng, config), roll)
    # The whole picture is turned instead of the head, which would show its crown from the side.
    turn_deg = float(rng.uniform(-180, 180)) if rng.random() < config.turned_share else 0.0
    which = int(rng.choice(3, p=np.asarray(config.distance_shares) / sum(config.distance_shares)))
    nearest, farthest = np.log(config.distances_mm[which : which + 2])
    off_axis = _cut_normal(rng, config.off_axis_deg, config.largest_off_axis_deg, 2)
    if rng.random() < config.off_centre_share:
        shift = rng.uniform(-config.off_centre_shift, config.off_centre_shift, 2)
    else:
        shift = _cut_normal(rng, config.shift, config.largest_shift, 2)
    return PhotographedView(
        pose=pose,
        turn_deg=turn_deg,
        distance_mm=float(np.exp(rng.uniform(nearest, farthest))),
        off_axis_deg=(float(off_axis[0]), float(off_axis[1])),
        picture_per_box=float(rng.uniform(*config.picture_per_box)),
        shift=(float(shift[0]), float(shift[1])),
    )


def photograph_face(landmarks_mm: Float64[ndarray, "m 3"], view: PhotographedView, size_px: int) -> Camera:
    """Returns a pinhole camera that shows a face (landmarks in mm, model frame) in a given view."""
    ray = np.append(np.tan(np.deg2rad(view.off_axis_deg)), 1)
    ray /= np.linalg.norm(ray)
    turn = np.asarray(Rotation.from_euler("z", view.turn_deg, degrees=True).as_matrix())
    rotation = _turned_onto(ray) @ turn @ rotation_of_pose(view.pose)
    translation = view.distance_mm * ray - rotation @ landmarks_mm.mean(axis=0)
    seen = landmarks_mm @ rotation.T + translation
    box = FaceBox.around(seen[:, :2] / seen[:, 2:])
    focal_px = size_px / (view.picture_per_box * box.longer_side)
    centre = box.centre + np.asarray(view.shift) * box.longer_side
    return pinhole_camera(Pinhole(float(focal_px), size_px / 2 - focal_px * centre, rotation, translation))


def camera_attributes(camera: Camera) -> dict[str, str | float]:
    """Returns focal length and principal point of a camera in pixels; empty for a camera without perspective."""
    if camera.is_affine:
        return {}
    pinhole = pinhole_of(camera)
    x, y = pinhole.principal_point_px
    return {
        FOCAL_LENGTH: round(pinhole.focal_px, 2),
        "principal_x_px": round(float(x), 2),
        "principal_y_px": round(float(y), 2),
    }


def _turned_onto(ray: Float64[ndarray, "3"]) -> Float64[ndarray, "3 3"]:
    """Returns the smallest rotation from the optical axis to a unit vector."""
    axis = np.array([-ray[1], ray[0], 0.0])  # z x ray
    sine = np.linalg.norm(axis)
    if not sine > 0:
        return np.eye(3)
    return np.asarray(Rotation.from_rotvec(axis / sine * np.arctan2(sine, ray[2])).as_matrix(), dtype=np.float64)


def _draw_yaw(rng: np.random.Generator, config: GeometryConfig) -> float:
    kind = rng.random()
    if kind < config.wide_yaw_share:
        yaw = rng.uniform(*config.wide_yaw_deg) * rng.choice([-1.0, 1.0])
    elif kind < config.wide_yaw_share + config.any_yaw_share:
        yaw = rng.uniform(-config.largest_yaw_deg, config.largest_yaw_deg)
    else:
        yaw = rng.normal(0, config.frontal_yaw_deg)
    return float(np.clip(yaw, -config.largest_yaw_deg, config.largest_yaw_deg))


def _draw_pitch(rng: np.random.Generator, config: GeometryConfig) -> float:
    if rng.random() < config.wide_pitch_share:
        return float(rng.uniform(-config.largest_pitch_deg, config.largest_pitch_deg))
    return float(_cut_normal(rng, config.pitch_deg, config.largest_pitch_deg, 1)[0])


def _cut_normal(rng: np.random.Generator, deviation: float, largest: float, n: int) -> Float64[ndarray, " n"]:
    return np.clip(rng.normal(0, deviation, n), -largest, largest)
