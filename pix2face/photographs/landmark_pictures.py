"""Where the landmarks of a model lie: its mean face from three sides, with numbered dots."""

import cv2
import numpy as np
from jaxtyping import Int, UInt8
from numpy import ndarray

from pix2face.geometry.camera import HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.models.morphable_model import MorphableModel
from pix2face.photographs.fit_pictures import shaded_face

YAWS_DEG = (0.0, 45.0, 90.0)
PANEL_PX = 640
# A face of some 240 mm, chin to hair line, with a margin.
MM_A_PANEL = 280.0
COLOURS = ((20, 140, 20), (210, 40, 40))
LETTER_SCALE = 0.36


def draw_model_landmarks(
    model: MorphableModel, choices: list[Int[ndarray, " m"]], panel_px: int = PANEL_PX
) -> UInt8[ndarray, "h w 3"]:
    """The mean face, frontal, half turned and in profile, with landmark vertices.

    Args:
        model: The model.
        choices: Up to two lists of vertices: the first is drawn in green, the second in red.
        panel_px: Side of each of the three panels.
    """
    panels = []
    face = model.mean[model.is_face_vertex]
    middle = (face.min(axis=0) + face.max(axis=0)) / 2
    for yaw_deg in YAWS_DEG:
        rotation = rotation_of_pose(HeadPose(0, yaw_deg, 0))
        scale = panel_px / MM_A_PANEL
        camera = weak_perspective_camera(
            WeakPerspective(scale, rotation, np.full(2, panel_px / 2) - scale * (rotation @ middle)[:2])
        )
        panel = shaded_face(np.full((panel_px, panel_px, 3), 255, np.uint8), model.mean, model, camera)
        for vertices, colour in zip(choices, COLOURS, strict=False):
            for number, (x, y) in enumerate(camera.project(model.mean[vertices])):
                place = (round(float(x)), round(float(y)))
                cv2.circle(panel, place, 2, colour, -1, cv2.LINE_AA)
                beside = (place[0] + 3, place[1] - 3)
                cv2.putText(panel, str(number), beside, cv2.FONT_HERSHEY_SIMPLEX, LETTER_SCALE, colour, 1, cv2.LINE_AA)
        panels.append(panel)
    return np.hstack(panels)
