"""A photograph of the small head, and a network that sees in it exactly what the oracle renders."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import torch
from numpy import ndarray
from torch import Tensor

from pix2face.detectors.detection import DetectedFace
from pix2face.files.images import encode_image
from pix2face.geometry.camera import Camera, HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.geometry.crops import INFERENCE_SCALE, FaceBox, crop_camera, square_crop
from pix2face.geometry.maps import FaceMaps
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.predictor import Predictor
from pix2face.inference.torch_networks import save_checkpoint
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.rasterise import render_maps
from pix2face.networks.dimensions import paper_widths
from pix2face.networks.paper import UNet
from tests.pix2face.stub_networks import predictor_of

SIZE_PX = 128
HEIGHT_PX, WIDTH_PX = 220, 260
PNCC_SCALE_MM, OFFSET_SCALE_MM = 150.0, 20.0


@dataclass(frozen=True, eq=False)
class PhotographedFace:
    """A face and the photograph of it, with everything that a fit should find."""

    model: MorphableModel
    identity: ndarray
    expression: ndarray
    pose: HeadPose
    camera: Camera

    @property
    def vertices(self) -> ndarray:
        return self.model.vertices(self.identity[None], self.expression[None])[0]

    @property
    def landmarks2d(self) -> ndarray:
        return self.camera.project(self.vertices[self.model.landmarks["ibug68"]])

    @property
    def box(self) -> FaceBox:
        return FaceBox.around(self.landmarks2d)

    def photograph(self) -> ndarray:
        """Skin from bright to dark with the depth, before blue noise."""
        seen = _rendered(self, self.camera, HEIGHT_PX, WIDTH_PX)
        image = np.random.default_rng(0).integers(0, 80, (HEIGHT_PX, WIDTH_PX, 3)) + np.array([0, 0, 100])
        image[seen["mask"]] = (150 - seen["depth"][seen["mask"]])[:, None] + np.array([40, 10, 0])
        return np.clip(image, 0, 255).astype(np.uint8)

    def maps(self, size_px: int = SIZE_PX) -> FaceMaps:
        """What an exact network of this size predicts in the crop of the face."""
        camera = crop_camera(self.camera, square_crop(self.box, INFERENCE_SCALE, size_px))
        maps = _rendered(self, camera, size_px, size_px)
        return FaceMaps(maps["pncc"], maps["offset"], maps["mask"])


@lru_cache(maxsize=32)
def _rendered_once(
    model: MorphableModel, vertices: bytes, camera: bytes, size_px: tuple[int, int]
) -> dict[str, ndarray]:
    points = np.frombuffer(vertices, np.float32).reshape(-1, 3)
    return render_maps(model, points, Camera(np.frombuffer(camera).reshape(4, 4)), *size_px)


def _rendered(face: PhotographedFace, camera: Camera, *size_px: int) -> dict[str, ndarray]:
    """The same few faces are seen in most tests."""
    seen = _rendered_once(face.model, face.vertices.tobytes(), camera.matrix.tobytes(), size_px)
    return {name: values.copy() for name, values in seen.items()}


class SureDetector:
    """Finds the same faces in every photograph."""

    def __init__(self, boxes: Sequence[FaceBox]) -> None:
        self.boxes = list(boxes)

    def detect(self, image: ndarray) -> list[FaceBox]:
        return self.boxes

    def candidates(self, image: ndarray) -> list[DetectedFace]:
        return [DetectedFace(box, 1.0) for box in self.boxes]


def photographed_face(
    model: MorphableModel, seed: int = 0, centre_px: tuple[float, float] = (140, 100)
) -> PhotographedFace:
    rng = np.random.default_rng(seed)
    pose = HeadPose(*rng.uniform(-15, 15, 3))
    camera = weak_perspective_camera(WeakPerspective(0.7, rotation_of_pose(pose), np.array(centre_px, dtype=float)))
    return PhotographedFace(model, rng.normal(size=model.n_identity), rng.normal(size=model.n_expression), pose, camera)


def header_of(model: MorphableModel, size_px: int = SIZE_PX) -> CheckpointHeader:
    return CheckpointHeader(
        model_name=model.name,
        model_sha256=model.sha256,
        size_px=size_px,
        # Networks that stand for others are of any size; those that are built, of powers of two.
        widths=paper_widths(size_px, 4) if size_px.bit_count() == 1 else (4,),
        pncc_scale_mm=PNCC_SCALE_MM,
        offset_scale_mm=OFFSET_SCALE_MM,
        smallest_radius_mm=model.smallest_radius_mm,
        licence="CC0-1.0",
        configuration="{}",
        epoch=1,
    )


def exact_predictor(model: MorphableModel, maps: Sequence[FaceMaps]) -> Predictor:
    """Predicts the given maps for the faces of a photograph, in their order, whatever the picture shows."""
    return predictor_of(network_of(maps), header_of(model))


def network_of(maps: Sequence[FaceMaps]) -> Callable[[Tensor], Tensor]:
    planes = np.stack(
        [np.concatenate([own.pncc / PNCC_SCALE_MM, own.offset / OFFSET_SCALE_MM], axis=2) for own in maps]
    )
    return lambda images: torch.from_numpy(planes[: len(images)]).permute(0, 3, 1, 2)


def write_picture(path: Path, image: ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(encode_image(image))
    return path


def write_checkpoint(path: Path, model: MorphableModel) -> Path:
    torch.manual_seed(0)
    save_checkpoint(path, header_of(model, 32), UNet(32, 4))
    return path
