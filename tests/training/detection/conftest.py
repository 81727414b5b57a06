"""People and pictures without people, small ones."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pix2face.files.images import encode_image
from pix2face.shards.layers import COVERAGE
from pix2face.shards.shard_writing import write_shard
from tests.synthetic_models import small_head_model
from tests.training.conftest import head_triplet, shard_header
from training.detection.people import PEOPLE_LAYERS


@pytest.fixture(scope="session")
def people_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shard of three heads, covered where their mask is."""
    folder, model = tmp_path_factory.mktemp("people"), small_head_model()
    triplets = [head_triplet(model, seed) for seed in range(3)]
    people = [replace(own, layers={COVERAGE: own.layers["mask"].astype(np.float32)}) for own in triplets]
    write_shard(folder / "shard-000000.h5", replace(shard_header(model), layers=PEOPLE_LAYERS), people)
    return folder


@pytest.fixture(scope="session")
def backgrounds_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four pictures of noise."""
    folder = tmp_path_factory.mktemp("backgrounds")
    for number in range(4):
        noise = np.random.default_rng(number).integers(0, 256, (40, 50, 3), dtype=np.uint8)
        (folder / f"{number}.png").write_bytes(encode_image(noise))
    return folder
