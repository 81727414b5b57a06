"""Shards of a synthetic head, rendered by the NumPy rasteriser."""

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from pix2face.files.images import encode_image
from pix2face.geometry.camera import HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.rasterise import render_maps
from pix2face.shards.sample import Sample
from pix2face.shards.shard_reader import ShardHeader
from pix2face.shards.shard_writing import write_shard
from tests.synthetic_models import small_head_model

PICTURE_PX = 72


def head_triplet(model: MorphableModel, seed: int) -> Sample:
    """One random face, grey by its depth on a noisy background."""
    rng = np.random.default_rng(seed)
    identity, expression = rng.normal(size=(1, model.n_identity)), rng.normal(size=(1, model.n_expression))
    vertices = model.vertices(identity, expression)[0]
    rotation = rotation_of_pose(HeadPose(*rng.uniform(-20, 20, 3)))
    centre = PICTURE_PX / 2 + rng.uniform(-5, 5, 2)
    camera = weak_perspective_camera(WeakPerspective(0.2, rotation, centre))
    rendered = render_maps(model, vertices, camera, PICTURE_PX, PICTURE_PX)
    image = rng.integers(0, 60, size=(PICTURE_PX, PICTURE_PX, 3)).astype(np.uint8)
    image[rendered["mask"]] = np.clip(150 - rendered["depth"][rendered["mask"]], 0, 255).astype(np.uint8)[:, None]
    landmarks3d = vertices[model.landmarks["ibug68"]]
    return Sample(
        sample_id=f"head-{seed:03d}",
        image_bytes=encode_image(image),
        layers={"pncc": rendered["pncc"], "offset": rendered["offset"], "mask": rendered["mask"]},
        camera=camera,
        identity=identity[0],
        expression=expression[0],
        landmarks2d=camera.project(landmarks3d),
        landmarks3d=landmarks3d,
        visible=np.ones(len(landmarks3d), dtype=bool),
        attributes={},
    )


def shard_header(model: MorphableModel, **changes: str) -> ShardHeader:
    fields = {
        "model_name": model.name,
        "model_sha256": model.sha256,
        "pncc_limit_mm": float(np.abs(model.mean).max()),
        "smallest_radius_mm": model.smallest_radius_mm,
        "licence": model.licence,
        "configuration": "{}",
        "generator": "tests",
    }
    return ShardHeader(**(fields | changes))


def copy_with_a_damaged_sample(shards_dir: Path, folder: Path) -> Path:
    """Copies a folder of shards and changes a byte of the maps of the sample head-004; returns its shard."""
    shutil.copytree(shards_dir, folder)
    path = folder / "shard-000001.h5"
    with h5py.File(path, "r") as file:
        offset = file["pncc_coded"].id.get_chunk_info(1).byte_offset
    content = bytearray(path.read_bytes())
    content[offset + 40] ^= 0xFF
    path.write_bytes(content)
    return path


@pytest.fixture(scope="session")
def shards_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two shards of three and two samples. Not to be written to."""
    folder, model = tmp_path_factory.mktemp("shards"), small_head_model()
    triplets = [head_triplet(model, seed) for seed in range(5)]
    write_shard(folder / "shard-000000.h5", shard_header(model), triplets[:3])
    write_shard(folder / "shard-000001.h5", shard_header(model), triplets[3:])
    return folder
