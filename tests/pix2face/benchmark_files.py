"""Small benchmarks on disk and stand-ins for predictor and fit, for tests of everything around them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import scipy.io
from jaxtyping import Float64, UInt8
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError
from pix2face.files.images import encode_image
from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.camera import FRONTAL, Camera, WeakPerspective, weak_perspective_camera
from pix2face.geometry.crops import FaceBox, square_crop
from pix2face.geometry.maps import FaceMaps
from pix2face.inference.predictor import Prediction
from pix2face.models.morphable_model import MorphableModel
from pix2face.shards.layers import DEFAULT_LAYERS
from pix2face.shards.sample import Sample
from pix2face.shards.shard_reader import ShardHeader
from pix2face.shards.shard_writing import write_shard
from tests.synthetic_models import small_head_model


def frontal_camera(scale: float = 0.8, centre_px: float = 100.0) -> Camera:
    return weak_perspective_camera(WeakPerspective(scale, FRONTAL, np.full(2, centre_px)))


def landmarks_of(model: MorphableModel, camera: Camera) -> Float64[ndarray, "68 2"]:
    return camera.project(model.mean[model.landmarks["ibug68"]])


def write_photograph(path: Path, seed: int = 0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    image = np.random.default_rng(seed).integers(0, 255, (200, 200, 3)).astype(np.uint8)
    cv2.imwrite(str(path), image)


def write_pts(path: Path, landmarks2d: Float64[ndarray, "n 2"]) -> None:
    write_points(path, landmarks2d + 0.5)  # files count from 1


def write_points(path: Path, points: Float64[ndarray, "n d"]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = "\n".join(" ".join(f"{value:.9f}" for value in point) for point in points)
    path.write_text(f"version: 1\nn_points: {len(points)}\n{{\n{lines}\n}}\n")


def write_mat(path: Path, landmarks2d: Float64[ndarray, "68 2"], yaw_deg: float, **changes: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    fields = {
        "Shape_Para": np.zeros((199, 1)),
        "Exp_Para": np.zeros((29, 1)),
        "Pose_Para": np.array([[0, np.radians(yaw_deg), 0, 100, 100, 0, 1e-3]], dtype=np.float32),
        "pt2d": np.full((2, 21), -1.0),
        "pt3d_68": np.vstack([landmarks2d.T + 0.5, np.zeros(68)]),
    }
    scipy.io.savemat(path, fields | changes)


# Of every sample of ``write_heldout``; skin tones differ.
ATTRIBUTES: dict[str, str | float] = {"skin.melanin": 0.0, "light.kind": "studio", "yaw_deg": 0.0, "seen_share": 1.0}


def write_heldout(
    folder: Path, model: MorphableModel, n: int = 2, sha256: str | None = None, seed: int = 1_000_000
) -> None:
    """The first samples of the split builtin-heldout (or of another seed) as a shard.

    Its maps are constant over a square: enough for everything that compares maps.
    """
    header = ShardHeader(
        model_name=model.name,
        model_sha256=sha256 or model.sha256,
        pncc_limit_mm=200.0,
        smallest_radius_mm=model.smallest_radius_mm,
        licence="CC0",
        configuration="{}",
        generator="test",
        layers=(*DEFAULT_LAYERS, "depth"),
    )
    write_shard(folder / "shard-00000.h5", header, [_triplet(model, i, seed) for i in range(n)])


def square_maps(pncc_mm: float = 80.0, offset_mm: float = 2.0) -> FaceMaps:
    mask = np.zeros((200, 200), dtype=bool)
    mask[60:140, 60:140] = True
    along_x = np.array([1, 0, 0], dtype=np.float32) * mask[..., None]
    return FaceMaps(np.float32(pncc_mm) * along_x, np.float32(offset_mm) * along_x, mask)


def _triplet(model: MorphableModel, index: int, seed: int) -> Sample:
    camera, maps = frontal_camera(), square_maps()
    return Sample(
        sample_id=f"seed{seed}/{index:07d}",
        image_bytes=encode_image(np.full((200, 200, 3), 30 * index, dtype=np.uint8)),
        layers={"pncc": maps.pncc, "offset": maps.offset, "mask": maps.mask, "depth": maps.pncc[..., 0]},
        camera=camera,
        identity=np.zeros(model.n_identity),
        expression=np.zeros(model.n_expression),
        landmarks2d=landmarks_of(model, camera),
        landmarks3d=model.mean[model.landmarks["ibug68"]].astype(np.float64),
        visible=np.ones(68, dtype=bool),
        attributes={name: 0.1 + 0.2 * index if name == "skin.melanin" else value for name, value in ATTRIBUTES.items()},
    )


@dataclass(frozen=True, eq=False)
class StubPredictor:
    """Predicts the given value everywhere in a crop of 100 px."""

    pncc_mm: float = 80.0
    offset_mm: float = 0.0

    def predict_batch(self, faces: Sequence[tuple[UInt8[ndarray, "_ _ 3"], FaceBox]]) -> list[Prediction]:
        return [self.predict(box) for _, box in faces]

    def predict(self, box: FaceBox) -> Prediction:
        along_x = np.array([1, 0, 0], dtype=np.float32) * np.ones((100, 100, 1), dtype=np.float32)
        maps = FaceMaps(self.pncc_mm * along_x, self.offset_mm * along_x, np.ones((100, 100), dtype=bool))
        return Prediction(maps, square_crop(box, 1.4, 100), box)


def stub_fit(landmarks2d: Float64[ndarray, "68 2"]) -> FaceFit:
    """A fit with these landmarks, in the pixels of the crop."""
    return FaceFit(frontal_camera(), np.zeros(12), np.zeros(6), small_head_model(), landmarks2d, np.ones((68, 3)))


def fit_that_fails(maps: FaceMaps, image_centre: Float64[ndarray, "2"]) -> FaceFit:
    raise DegenerateGeometryError("expected 50 valid pixels, found 0")
