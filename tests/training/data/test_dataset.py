import pickle
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pix2face.errors import InputFileError, UsageError
from pix2face.files.images import encode_image
from pix2face.geometry.crops import FaceBox, square_crop
from pix2face.geometry.jitter import JitterRange, crop_maps
from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM
from pix2face.shards.sample import Sample
from pix2face.shards.shard_writing import write_shard
from tests.synthetic_models import small_head_model
from tests.training.conftest import PICTURE_PX, head_triplet, shard_header
from training.data import dataset as dataset_module
from training.data.batches import as_input, empty_batch, target_planes
from training.data.dataset import DrawDataset
from training.data.decoded_sample import decode_sample
from training.data.shard_index import ShardIndex, index_shards
from training.loop.validation import ValidationSet
from training.recipe.presets import PRESETS

RECIPE = replace(PRESETS["tiny"], size_px=32, filters=4, batch_size=2)
STILL = JitterRange(scale=(1.4, 1.4), shift=0.0, rotation_deg=0.0, gamma=(1.0, 1.0), gain=1.0)


@pytest.fixture
def shards(shards_dir):
    return index_shards([shards_dir])


def assert_same(first, second):
    for name in ("image", "pncc", "offset", "mask"):
        assert torch.equal(getattr(first, name), getattr(second, name)), name


@pytest.mark.parametrize("cropping", ["full", "box", "shift", "none"])
def test_a_draw_is_the_same_whoever_computes_it(shards, cropping):
    recipe = replace(RECIPE, cropping=cropping)
    dataset, other = DrawDataset(shards, recipe), DrawDataset(shards, recipe, 10**7)
    for draw in (7, 0, 3, 7):
        assert_same(dataset[draw], other[draw])
    together = other.batch([7, 0, 3])
    assert_same(together[1:2], dataset[0])
    assert len(together) == 3


@pytest.mark.parametrize("cropping", ["full", "box", "shift"])
def test_each_pass_takes_every_sample_once_with_new_jitter(shards, cropping):
    still = DrawDataset(shards, replace(RECIPE, jitter=STILL, cropping="full" if cropping == "full" else "none"))
    pictures = [still[draw].image.numpy().tobytes() for draw in range(15)]
    assert Counter(Counter(pictures).values()) == {3: 5}
    assert pictures[:5] != pictures[5:10]
    jittered = DrawDataset(shards, replace(RECIPE, cropping=cropping))
    assert len({jittered[draw].image.numpy().tobytes() for draw in range(15)}) == 15


def test_another_seed_draws_otherwise(shards):
    first, second = (DrawDataset(shards, replace(RECIPE, seed=seed)) for seed in (0, 1))
    assert not torch.equal(first[0].image, second[0].image)


def test_targets_are_the_maps_of_the_crop_over_their_scales(shards):
    """Cutting the stored maps to the face changes nothing."""
    dataset = DrawDataset(shards, replace(RECIPE, jitter=STILL))
    scales_mm = shards.pncc_scale_mm, shards.offset_scale_mm
    seen = 0
    for draw in range(5):
        batch = dataset[draw]
        target = target_planes(batch, *scales_mm)[0].numpy().transpose(1, 2, 0)
        for reader in shards.readers:
            for position in range(len(reader)):
                crop = square_crop(FaceBox.around(reader.read(position, ()).landmarks2d), 1.4, 32)
                maps = crop_maps(reader.read(position).maps, crop)
                expected = np.dstack([maps.pncc / scales_mm[0], maps.offset / scales_mm[1]])
                tolerance = 0.51 / FIXED_POINT_STEPS_PER_MM / min(scales_mm)
                if np.allclose(target, expected, rtol=0, atol=tolerance):
                    seen += 1
                    assert np.array_equal(batch.mask[0].numpy(), maps.mask)
    assert seen == 5


@pytest.mark.parametrize("cropping", ["full", "shift"])
def test_a_mirrored_sample_is_the_mirror_image_with_x_negated(shards, cropping):
    """Two data sets that differ in nothing but mirroring: every draw is the same, or its mirror image."""
    cropping = "none" if cropping == "shift" else cropping
    plain = DrawDataset(shards, replace(RECIPE, jitter=STILL, cropping=cropping))
    mirrored = DrawDataset(shards, replace(RECIPE, jitter=replace(STILL, mirror=True), cropping=cropping))
    sign = torch.tensor([-1.0, 1, 1])[:, None, None]
    n_mirrored = 0
    for draw in range(30):
        one, other = plain[draw], mirrored[draw]
        image, steps = other.image, other.pncc.float()
        is_mirrored = not torch.equal(one.image, image)
        n_mirrored += is_mirrored
        if is_mirrored:
            image, steps = image.flip(3), steps.flip(3) * sign
        assert (one.image.int() - image.int()).abs().max() < 5
        off = ((one.pncc - steps).abs().amax(dim=1) > 1).float().mean()
        assert off < 0.02  # at the outline, where half a weight goes either way
        if cropping == "none":
            assert off == 0
    assert 8 < n_mirrored < 22


def test_a_square_is_cut_at_whole_pixels_with_its_maps(shards):
    """Picture and maps of a draw are one and the same part of the stored ones, at a place that varies."""
    dataset = DrawDataset(shards, replace(RECIPE, jitter=STILL, cropping="shift", size_px=64))
    stored = []
    for reader in shards.readers:
        stored += [
            (reader.read(k).image, *reader.stored(k, ("pncc", "mask"), is_whole=True).values())
            for k in range(len(reader))
        ]
    corners = set()
    for draw in range(20):
        batch = dataset[draw]
        image = batch.image[0].permute(1, 2, 0).numpy()
        found = [
            (number, top, left)
            for number, (picture, _, _) in enumerate(stored)
            for top in range(PICTURE_PX - 64 + 1)
            for left in range(PICTURE_PX - 64 + 1)
            if np.array_equal(picture[top : top + 64, left : left + 64], image)
        ]
        assert len(found) == 1
        number, top, left = found[0]
        corners.add((top, left))
        part = np.s_[top : top + 64, left : left + 64]
        assert np.array_equal(batch.pncc[0].permute(1, 2, 0).numpy(), stored[number][1][part])
        assert np.array_equal(batch.mask[0].numpy(), stored[number][2][part])
    assert len(corners) > 10


def test_values_are_in_the_networks_range(shards):
    dataset = DrawDataset(shards, RECIPE)
    for draw in range(20):
        batch = dataset[draw]
        image, target = as_input(batch.image), target_planes(batch, shards.pncc_scale_mm, shards.offset_scale_mm)
        assert image.shape == (1, 3, 32, 32)
        assert target.shape == (1, 6, 32, 32)
        assert image.dtype == target.dtype == torch.float32
        assert image.min() >= -0.5
        assert image.max() <= 0.5
        assert target.abs().max() <= 1
        assert (target[:, :3].abs().amax(dim=1) > 0).float().mean() > 0.1
        assert torch.equal(target[:, :3].abs().amax(dim=1) > 0, batch.mask.bool())


def test_batches_are_channels_last_in_memory(shards):
    batch = DrawDataset(shards, RECIPE).batch([0, 1])
    for planes in (batch.image, batch.pncc, as_input(batch.image), target_planes(batch, 1.0, 1.0)):
        assert planes.is_contiguous(memory_format=torch.channels_last)


def test_a_dataset_travels_to_other_processes(shards):
    dataset = DrawDataset(shards, RECIPE)
    expected = dataset[3]
    copy = pickle.loads(pickle.dumps(dataset))
    assert_same(copy[3], expected)


@pytest.mark.parametrize("cropping", ["full", "box", "shift"])
def test_a_sample_without_a_face_has_targets_of_background(tmp_path, cropping):
    model = small_head_model()
    seen = head_triplet(model, 0)
    nothing = {name: np.zeros_like(values) for name, values in seen.layers.items()}
    write_shard(tmp_path / "shard-00000.h5", shard_header(model), [replace(seen, layers=nothing)])
    batch = DrawDataset(index_shards([tmp_path]), replace(RECIPE, cropping=cropping))[0]
    assert batch.image.any()
    assert not batch.pncc.any()
    assert not batch.mask.any()
    assert batch.seen is None


@pytest.mark.parametrize("cropping", ["full", "box", "shift", "none"])
def test_where_the_face_is_seen_comes_along(tmp_path, cropping):
    model = small_head_model()
    triplet = head_triplet(model, 0)
    seen = triplet.layers["mask"].copy()
    seen[:, : PICTURE_PX // 2] = False
    header = replace(shard_header(model), layers=("image", "pncc", "offset", "mask", "seen", "landmarks"))
    write_shard(tmp_path / "shard-00000.h5", header, [replace(triplet, layers=triplet.layers | {"seen": seen})])
    batch = DrawDataset(index_shards([tmp_path]), replace(RECIPE, jitter=STILL, cropping=cropping))[0]
    assert ((batch.seen == 1) <= (batch.mask == 1)).all()
    share = float(batch.seen.sum() / batch.mask.sum())
    assert 0.2 < share < 0.8


def test_pictures_that_are_too_small_to_cut_from_are_refused_with_the_way_out(shards):
    dataset = DrawDataset(shards, replace(RECIPE, size_px=128, cropping="shift"))
    with pytest.raises(UsageError, match=r"at least 128 x 128 pixels.*found 72 x 72; give --cropping full"):
        dataset[0]


def test_a_sample_whose_landmarks_have_no_box_is_named(tmp_path):
    model = small_head_model()
    triplet = replace(head_triplet(model, 0), landmarks2d=np.full((68, 2), 5.0))
    write_shard(tmp_path / "shard-00000.h5", shard_header(model), [triplet])
    index = index_shards([tmp_path])
    with pytest.raises(InputFileError, match=r"shard-00000\.h5, sample 0: a face box needs .*--cropping shift"):
        DrawDataset(index, RECIPE)[0]
    assert DrawDataset(index, replace(RECIPE, cropping="shift"))[0].mask.any()


def test_an_empty_batch_knows_what_is_seen_only_where_the_sets_do():
    assert empty_batch(2, 8, has_seen=False).seen is None
    batch = empty_batch(2, 8, has_seen=True)
    assert batch.seen.shape == (2, 8, 8)
    assert batch.to("cpu")[:1].seen.shape == (1, 8, 8)


def not_square(tmp_path: Path, cut: tuple[slice, slice]) -> tuple[ShardIndex, Sample]:
    """A set of one picture, cut from a head's square one, and that sample."""
    model = small_head_model()
    sample = head_triplet(model, 0)
    layers = {name: values[cut] for name, values in sample.layers.items()}
    sample = replace(sample, image_bytes=encode_image(sample.image[cut]), layers=layers)
    write_shard(tmp_path / "shard-00000.h5", shard_header(model), [sample])
    return index_shards([tmp_path]), sample


@pytest.mark.parametrize("cut", [np.s_[:60, :], np.s_[:, 10:]])
def test_the_middle_of_a_picture_that_is_not_square(tmp_path, cut):
    """Of a wide picture columns are left out at both sides, of a high one rows."""
    shards, sample = not_square(tmp_path, cut)
    height, width = sample.layers["mask"].shape
    top, left = (height - 56) // 2, (width - 56) // 2
    assert top != left
    batch = DrawDataset(shards, replace(RECIPE, jitter=STILL, cropping="none", size_px=56))[0]
    part = np.s_[top : top + 56, left : left + 56]
    assert np.array_equal(batch.image[0].permute(1, 2, 0).numpy(), sample.image[part])
    assert np.array_equal(batch.mask[0].numpy(), sample.layers["mask"][part])
    assert np.array_equal(batch.pncc[0].permute(1, 2, 0).numpy(), np.rint(sample.layers["pncc"][part] * 128))
    kept = ValidationSet(shards, replace(RECIPE, cropping="none", size_px=56))
    assert np.array_equal(next(kept.batches(1)).image[0].permute(1, 2, 0).numpy(), sample.image[part])
    assert np.allclose(kept.landmarks2d[0], sample.landmarks2d - (left, top), atol=1e-4)


def test_squares_are_cut_from_all_of_a_picture_that_is_not_square(tmp_path):
    """And from nothing beyond it, whose rows and columns a batch could not be filled with."""
    shards, sample = not_square(tmp_path, np.s_[:60, :])
    dataset = DrawDataset(shards, replace(RECIPE, jitter=STILL, cropping="shift", size_px=56))
    corners = set()
    for draw in range(60):
        image = dataset[draw].image[0].permute(1, 2, 0).numpy()
        (corner,) = [
            (top, left)
            for top in range(5)
            for left in range(17)
            if np.array_equal(sample.image[top : top + 56, left : left + 56], image)
        ]
        corners.add(corner)
    assert {top for top, _ in corners} == set(range(5))
    assert max(left for _, left in corners) > 12


def test_a_checksum_is_compared_when_a_sample_is_first_read_alone(shards, monkeypatch):
    checked = []

    def noted(*arguments, is_checked):
        checked.append(is_checked)
        return decode_sample(*arguments, is_checked=is_checked)

    monkeypatch.setattr(dataset_module, "decode_sample", noted)
    dataset = DrawDataset(shards, RECIPE)
    for draw in range(15):
        dataset[draw]
    assert checked == [True] * 5 + [False] * 10
