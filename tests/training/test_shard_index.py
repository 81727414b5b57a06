import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pix2face.errors import InputFileError, ModelMismatchError, UsageError
from pix2face.shards.layers import DEFAULT_LAYERS
from pix2face.shards.shard_reader import ShardReader
from pix2face.shards.shard_writing import write_shard
from tests.synthetic_models import small_head_model
from tests.training.conftest import head_triplet, shard_header
from training.shard_index import index_shards


def test_every_sample_is_listed_once(shards_dir):
    index = index_shards([shards_dir])
    assert len(index) == 5
    assert index.shard.tolist() == [0, 0, 0, 1, 1]
    assert index.position.tolist() == [0, 1, 2, 0, 1]
    assert index.model_sha256 == small_head_model().sha256


def test_scales_cover_every_target(shards_dir):
    index = index_shards([shards_dir])
    assert index.offset_scale_mm % 5 == 0
    largest_pncc, largest_offset = 0.0, 0.0
    for path in index.paths:
        with ShardReader(path) as reader:
            for position in range(len(reader)):
                maps = reader.maps(position)
                largest_pncc = max(largest_pncc, np.abs(maps.pncc).max())
                largest_offset = max(largest_offset, np.abs(maps.offset).max())
    assert largest_pncc <= index.pncc_scale_mm
    assert index.offset_scale_mm - 5 < largest_offset <= index.offset_scale_mm


def test_several_folders_make_one_set(shards_dir):
    twice = index_shards([shards_dir, shards_dir])
    assert len(twice) == 10
    assert twice.samples_sha256 != index_shards([shards_dir]).samples_sha256


def test_shards_of_two_models_are_refused_and_both_are_named(shards_dir, tmp_path):
    model = small_head_model()
    header = shard_header(model, model_name="another head", model_sha256="f" * 64)
    write_shard(tmp_path / "shard-000000.h5", header, [head_triplet(model, 9)])
    with pytest.raises(
        ModelMismatchError, match=r"'another head' \(ffffffffffff\).*'small synthetic head' \(000000000000\)"
    ):
        index_shards([shards_dir, tmp_path])


def test_a_shard_cut_in_half_is_named(shards_dir, tmp_path):
    shutil.copytree(shards_dir, tmp_path / "shards")
    path = tmp_path / "shards" / "shard-000001.h5"
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(InputFileError, match=r"shard-000001\.h5"):
        index_shards([tmp_path / "shards"])


def test_nothing_to_train_on_is_said(tmp_path):
    with pytest.raises(UsageError, match="expected one folder of shards or more"):
        index_shards([])
    with pytest.raises(UsageError, match="no such folder"):
        index_shards([tmp_path / "missing"])
    write_shard(tmp_path / "shard-000000.h5", shard_header(small_head_model()), [])
    with pytest.raises(UsageError, match="found empty shards alone"):
        index_shards([tmp_path])


def test_licences_are_kept(shards_dir, tmp_path):
    model = small_head_model()
    write_shard(tmp_path / "shard-000000.h5", shard_header(model, licence="research only"), [head_triplet(model, 9)])
    assert index_shards([Path(shards_dir), tmp_path]).licence == "CC0-1.0; research only"


@pytest.mark.parametrize("lacking", ["image", "offset", "landmarks"])
def test_shards_without_a_layer_to_train_on_are_refused_before_any_work(tmp_path, lacking):
    model = small_head_model()
    layers = tuple(name for name in DEFAULT_LAYERS if name != lacking)
    header = replace(shard_header(model), layers=layers)
    write_shard(tmp_path / "shard-00000.h5", header, [head_triplet(model, 0)])
    with pytest.raises(UsageError, match=rf"shard-00000\.h5: expected the layers .*, found no {lacking}; render with"):
        index_shards([tmp_path])
