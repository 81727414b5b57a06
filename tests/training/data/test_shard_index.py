from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pix2face.errors import ModelMismatchError, UsageError
from pix2face.shards.layers import DEFAULT_LAYERS
from pix2face.shards.shard_writing import write_shard
from tests.synthetic_models import small_head_model
from tests.training.conftest import head_triplet, shard_header
from training.data.shard_folders import ShardFolder
from training.data.shard_index import index_shards, split_off


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
    for reader in index.readers:
        for position in range(len(reader)):
            maps = reader.read(position).maps
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


@pytest.fixture
def two_folders(tmp_path):
    """Five faces with yaw of 0 to 40 degrees in two folders: three and two."""
    model = small_head_model()
    for folder, seeds in (("a", range(3)), ("b", range(3, 5))):
        faces = [
            replace(head_triplet(model, seed), attributes={"yaw_deg": 10.0 * seed, "light": "sun" if seed else "night"})
            for seed in seeds
        ]
        write_shard(tmp_path / folder / "shard-00000.h5", shard_header(model), faces)
    return [tmp_path / "a", tmp_path / "b"]


def test_folders_without_weights_are_one_set_and_with_weights_some(two_folders):
    (one,) = index_shards(two_folders).sets
    assert (one.weight, one.samples.tolist()) == (1.0, [0, 1, 2, 3, 4])
    weighted = index_shards([ShardFolder(path, weight) for path, weight in zip(two_folders, (3, 1), strict=True)])
    assert [(found.weight, found.samples.tolist()) for found in weighted.sets] == [(0.75, [0, 1, 2]), (0.25, [3, 4])]


def test_a_condition_chooses_samples(two_folders):
    index = index_shards(two_folders, where="yaw_deg < 35 and light != 'night'")
    assert index.samples.tolist() == [1, 2, 3]
    assert (len(index), index.n_samples) == (3, 5)
    assert index.description == "3 in 2 shards (3 of 5 where yaw_deg < 35 and light != 'night')"
    weighted = index_shards([ShardFolder(path, 1) for path in two_folders], where="yaw_deg >= 20")
    assert [found.samples.tolist() for found in weighted.sets] == [[2], [3, 4]]


def test_a_condition_that_nothing_fulfils_or_that_names_nothing_is_refused(two_folders):
    with pytest.raises(
        UsageError, match=r"expected samples that --where lets pass, found none of 5; `datagen stats --all`"
    ):
        index_shards(two_folders, where="yaw_deg > 100")
    with pytest.raises(UsageError, match=r"b: expected samples that --where lets pass, found none"):
        index_shards([ShardFolder(path, 1) for path in two_folders], where="yaw_deg < 20")
    with pytest.raises(UsageError, match=r"--where 'yaw > 1': expected attributes among light, sample_id, yaw_deg"):
        index_shards(two_folders, where="yaw > 1")


def test_the_configuration_tells_trainings_on_other_data_apart(two_folders):
    folders = [ShardFolder(path, 1) for path in two_folders]
    indices = [
        index_shards(two_folders),
        index_shards(two_folders[::-1]),
        index_shards(two_folders, where="yaw_deg < 35"),
        index_shards(folders),
        split_off(index_shards(two_folders), 0.5)[0],
    ]
    assert len({repr(index.configuration()) for index in indices}) == len(indices)


def test_a_share_of_the_persons_is_held_out_whatever_the_order(tmp_path):
    model = small_head_model()
    face = head_triplet(model, 0)
    rng = np.random.default_rng(0)
    faces = []
    for person in range(60):
        identity = rng.normal(size=model.n_identity)
        faces += [replace(face, sample_id=f"{person}-{take}", identity=identity) for take in range(2)]
    write_shard(tmp_path / "a" / "shard-00000.h5", shard_header(model), faces)
    write_shard(tmp_path / "b" / "shard-00000.h5", shard_header(model), faces[::-1])
    index = index_shards([tmp_path / "a"])
    assert len(set(index.person.tolist())) == 60
    own, held_out = split_off(index, 0.3)
    assert 10 <= len(held_out) / 2 <= 26
    assert len(own) + len(held_out) == 120
    assert own.description == f"{len(own)} in 1 shard ({len(held_out)} held out)"
    assert not set(index.person[own.samples]) & set(index.person[held_out.samples])
    more = split_off(index, 0.5)[1]
    assert set(held_out.samples.tolist()) < set(more.samples.tolist())
    backwards = split_off(index_shards([tmp_path / "b"]), 0.3)[1]
    assert {119 - place for place in backwards.samples.tolist()} == set(held_out.samples.tolist())


@pytest.mark.parametrize(("fraction", "what"), [(1e-9, "to validate with"), (0.999999999, "to train on")])
def test_an_empty_part_is_refused(shards_dir, fraction, what):
    with pytest.raises(UsageError, match=rf"--validation .*expected samples {what} in each set.*among 5 persons"):
        split_off(index_shards([shards_dir]), fraction)
