import pickle
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from pix2face.crops import FaceBox, square_crop
from pix2face.jitter import JitterRange, crop_maps
from pix2face.shards.shard_reader import ShardReader
from pix2face.shards.shard_writing import write_shard
from tests.synthetic_models import small_head_model
from tests.training.conftest import head_triplet, shard_header
from training.dataset import EpochDraws, TripletDataset
from training.presets import PRESETS
from training.shard_index import index_shards

RECIPE = replace(PRESETS["tiny"], size_px=32, filters=4, batch_size=2)
STILL = JitterRange(scale=(1.4, 1.4), shift=0.0, rotation_deg=0.0, gamma=(1.0, 1.0), gain=1.0)


@pytest.fixture
def shards(shards_dir):
    return index_shards([shards_dir])


def test_a_draw_is_the_same_whoever_computes_it(shards):
    dataset, other = TripletDataset(shards, RECIPE), TripletDataset(shards, RECIPE, cache_bytes=10**8)
    for draw in (7, 0, 3, 7):
        for first, second in zip(dataset[draw], other[draw], strict=True):
            torch.testing.assert_close(first, second, rtol=0, atol=0)


def test_worker_processes_change_nothing(shards):
    def draw_all(workers: int) -> list[torch.Tensor]:
        draws = EpochDraws(6)
        draws.epoch = 2
        loader = DataLoader(
            TripletDataset(shards, RECIPE),
            batch_size=2,
            sampler=draws,
            num_workers=workers,
            multiprocessing_context="spawn" if workers else None,
        )
        return [tensor for batch in loader for tensor in batch]

    for alone, shared in zip(draw_all(0), draw_all(2), strict=True):
        torch.testing.assert_close(alone, shared, rtol=0, atol=0)


def test_each_pass_takes_every_sample_once_with_new_jitter(shards):
    dataset = TripletDataset(shards, replace(RECIPE, jitter=STILL))
    pictures = [dataset[draw][0].numpy().tobytes() for draw in range(15)]
    assert Counter(Counter(pictures).values()) == {3: 5}
    assert pictures[:5] != pictures[5:10]
    jittered = TripletDataset(shards, RECIPE)
    assert len({jittered[draw][0].numpy().tobytes() for draw in range(15)}) == 15


def test_another_seed_draws_otherwise(shards):
    first, second = (TripletDataset(shards, replace(RECIPE, seed=seed)) for seed in (0, 1))
    assert not torch.equal(first[0][0], second[0][0])


def test_targets_are_the_maps_of_the_crop_over_their_scales(shards):
    """Cutting the stored maps to the face changes nothing."""
    dataset = TripletDataset(shards, replace(RECIPE, jitter=STILL))
    seen = 0
    for draw in range(5):
        target = dataset[draw][1].numpy().transpose(1, 2, 0)
        for path in shards.paths:
            with ShardReader(path) as reader:
                for position in range(len(reader)):
                    crop = square_crop(FaceBox.around(reader.landmarks2d(position)), 1.4, 32)
                    maps = crop_maps(reader.maps(position), crop)
                    expected = np.dstack([maps.pncc / shards.pncc_scale_mm, maps.offset / shards.offset_scale_mm])
                    seen += np.allclose(target, expected, atol=1e-4)
    assert seen == 5


def test_a_mirrored_sample_is_the_mirror_image_with_x_negated(shards):
    """Two data sets that differ in nothing but mirroring: every draw is the same, or its mirror image."""
    plain = TripletDataset(shards, replace(RECIPE, jitter=STILL))
    mirrored = TripletDataset(shards, replace(RECIPE, jitter=replace(STILL, mirror=True)))
    sign = torch.tensor([-1.0, 1, 1, -1, 1, 1])[:, None, None]
    n_mirrored = 0
    for draw in range(30):
        (image, target), (other_image, other_target) = plain[draw], mirrored[draw]
        is_mirrored = not torch.equal(image, other_image)
        n_mirrored += is_mirrored
        if is_mirrored:
            other_image, other_target = other_image.flip(2), other_target.flip(2) * sign
            assert (image - other_image).abs().max() < 0.02
        off = (target - other_target).abs().amax(dim=0) > 1e-3
        assert off.float().mean() < 0.02  # at the outline, where half a weight goes either way
    assert 8 < n_mirrored < 22


def test_values_are_in_the_networks_range(shards):
    dataset = TripletDataset(shards, RECIPE)
    for draw in range(20):
        image, target = dataset[draw]
        assert image.shape == (3, 32, 32)
        assert target.shape == (6, 32, 32)
        assert image.dtype == target.dtype == torch.float32
        assert image.min() >= -0.5
        assert image.max() <= 0.5
        assert target.abs().max() <= 1
        assert (target[:3].abs().amax(dim=0) > 0).float().mean() > 0.1


def test_the_cache_keeps_to_its_limit(shards):
    sample_bytes = TripletDataset(shards, RECIPE)._decoded(0).bytes
    dataset = TripletDataset(shards, RECIPE, cache_bytes=int(2.5 * sample_bytes))
    for draw in range(10):
        dataset[draw]
    assert dataset._cached_bytes <= 2.5 * sample_bytes
    assert 1 <= len(dataset._cache) <= 3


def test_a_dataset_travels_to_other_processes_without_its_open_files(shards):
    dataset = TripletDataset(shards, RECIPE, cache_bytes=10**8)
    expected = dataset[3]
    copy = pickle.loads(pickle.dumps(dataset))
    assert not copy._readers
    torch.testing.assert_close(copy[3], expected, rtol=0, atol=0)


def test_epochs_are_consecutive_draws():
    draws = EpochDraws(4)
    assert list(draws) == [0, 1, 2, 3]
    draws.epoch = 3
    assert list(draws) == [12, 13, 14, 15]
    assert len(draws) == 4


def test_a_sample_without_a_face_has_targets_of_background(tmp_path):
    model = small_head_model()
    seen = head_triplet(model, 0)
    nothing = {name: np.zeros_like(values) for name, values in seen.layers.items()}
    write_shard(tmp_path / "shard-00000.h5", shard_header(model), [replace(seen, layers=nothing)])
    image, target = TripletDataset(index_shards([tmp_path]), RECIPE)[0]
    assert image.isfinite().all()
    assert target.shape == (6, RECIPE.size_px, RECIPE.size_px)
    assert (target == 0).all()
