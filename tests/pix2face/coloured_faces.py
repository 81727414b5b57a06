"""Pictures whose colours are the PNCC of a mean face, and stand-ins for detector and network that read them."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
import torch
from numpy import ndarray
from torch import Tensor

from pix2face.detectors.protocol import DetectedFace, sure_boxes
from pix2face.geometry.camera import Camera, HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.geometry.crops import FaceBox
from pix2face.geometry.landmarks import IBUG68
from pix2face.inference.predictor import Predictor
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.rasterise import render_maps
from pix2face.networks import MAP_PLANES, SEEN_PLANE
from tests.pix2face.photographs.seen_faces import header_of
from tests.pix2face.stub_networks import predictor_of

HEIGHT_PX, WIDTH_PX = 120, 160
SPAN_MM = 300.0  # of the 254 grey levels from 1 to 255
SCALE = 0.4


def camera_at(x: float, y: float, yaw_deg: float = 0.0, scale: float = SCALE) -> Camera:
    rotation = rotation_of_pose(HeadPose(0, yaw_deg, 0))
    return weak_perspective_camera(WeakPerspective(scale, rotation, np.array([x, y], dtype=float)))


def draw_faces(
    model: MorphableModel, cameras: Sequence[Camera], size: tuple[int, int] = (HEIGHT_PX, WIDTH_PX)
) -> ndarray:
    """An RGB picture of mean faces, each pixel with its PNCC as colour, on black."""
    image = np.zeros((*size, 3), dtype=np.uint8)
    for camera in cameras:
        seen = render_maps(model, model.mean, camera, *size)
        colours = np.clip(np.rint((seen["pncc"] / SPAN_MM + 0.5) * 254 + 1), 1, 255)
        image[seen["mask"]] = colours[seen["mask"]]
    return image


def true_landmarks(model: MorphableModel, camera: Camera) -> ndarray:
    return camera.project(model.mean[model.landmarks[IBUG68]])


def true_box(model: MorphableModel, camera: Camera) -> FaceBox:
    return FaceBox.around(true_landmarks(model, camera))


def colour_network(planes_of_pncc: float, says_seen: bool) -> Callable[[Tensor], Tensor]:
    """From a crop of such a picture to its PNCC, with offset 0; and, if wanted, to the masks of a face that is seen."""

    def network(images: Tensor) -> Tensor:
        levels = (images + 0.5) * 255
        pncc_mm = ((levels - 1) / 254 - 0.5) * SPAN_MM
        is_coloured = levels.amin(dim=1) > 2  # beside the face, blends with black
        is_face = torch.stack([_largest_blob(own) for own in is_coloured])[:, None]
        masks = [is_face.float() - 0.5] * (2 if says_seen else 0)
        return torch.cat([pncc_mm * is_face / planes_of_pncc, torch.zeros_like(images), *masks], dim=1)

    return network


def _largest_blob(mask: Tensor) -> Tensor:
    """As networks do, which see one face in a crop."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.numpy().astype(np.uint8))
    return torch.from_numpy(labels == 1 + np.argmax(stats[1:, 4])) & mask if len(stats) > 1 else mask


def colour_predictor(model: MorphableModel, size_px: int = 96, *, says_seen: bool = False) -> Predictor:
    header = replace(header_of(model, size_px), planes=SEEN_PLANE + 1 if says_seen else MAP_PLANES)
    return predictor_of(colour_network(header.pncc_scale_mm, says_seen), header)


class BlobDetector:
    """Takes every blob that is not black for a face; its boxes are the blobs', which are larger than the landmarks'."""

    def detect(self, image: ndarray) -> list[FaceBox]:
        return sure_boxes(self.candidates(image))

    def candidates(self, image: ndarray) -> list[DetectedFace]:
        bright = (image.max(axis=2) > 40).astype(np.uint8)
        count, _, stats, _ = cv2.connectedComponentsWithStats(bright)
        faces = []
        for index in range(1, count):
            left, top, width, height, area = (float(value) for value in stats[index])
            if area > 100:
                faces.append(DetectedFace(FaceBox(left, top, left + width, top + height), 2.0))
        return faces
