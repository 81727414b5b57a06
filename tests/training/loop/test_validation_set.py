from dataclasses import replace

import numpy as np
import pytest
import torch

from tests.training.data.test_dataset import RECIPE
from training.data.shard_index import index_shards, split_off
from training.loop.validation import ValidationSet


@pytest.fixture
def shards(shards_dir):
    return index_shards([shards_dir])


@pytest.mark.parametrize("cropping", ["full", "box", "shift", "none"])
def test_it_is_the_same_list_however_it_is_batched(shards, cropping):
    recipe = replace(RECIPE, cropping=cropping)
    by_two, at_once = (
        list(ValidationSet(shards, replace(recipe, seed=seed)).batches(size)) for seed, size in ((0, 2), (5, 100))
    )
    assert [len(batch) for batch in by_two] == [2, 2, 1]
    assert torch.equal(torch.cat([batch.image for batch in by_two]), at_once[0].image)
    assert torch.equal(torch.cat([batch.pncc for batch in by_two]), at_once[0].pncc)


@pytest.mark.parametrize(("cropping", "size_px"), [("full", 64), ("box", 64), ("shift", 64), ("none", 32)])
def test_landmarks_lie_where_the_network_sees_them(shards, cropping, size_px):
    """The tip of the nose is where PNCC reaches furthest out of the face, in each crop."""
    found = ValidationSet(shards, replace(RECIPE, cropping=cropping, size_px=size_px))
    (batch,) = found.batches(10)
    assert found.landmarks2d.shape == (5, 68, 2)
    model_tips = []
    for steps, mask, landmarks2d in zip(batch.pncc.numpy(), batch.mask.numpy(), found.landmarks2d, strict=True):
        pixel = np.floor(landmarks2d).astype(int)
        inside = (pixel >= 0).all(axis=1) & (pixel < size_px).all(axis=1)
        at_landmarks = steps[:, pixel[inside, 1], pixel[inside, 0]]
        assert mask[pixel[inside, 1], pixel[inside, 0]].mean() > 0.6
        model_tips.append((inside, at_landmarks))
    # The same landmark is the same point of the mean face in every picture.
    both = model_tips[0][0] & model_tips[1][0]
    one, other = (tips[1][:, both[tips[0]]].astype(float) / 128 for tips in model_tips[:2])
    seen = (np.abs(one).sum(axis=0) > 0) & (np.abs(other).sum(axis=0) > 0)
    assert np.median(np.linalg.norm(one - other, axis=0)[seen]) < 12


def test_only_so_many_are_taken_always_the_same(shards):
    few = ValidationSet(shards, RECIPE, most=2)
    assert len(few) == 2
    assert len(next(few.batches(8))) == 2
    assert few.numbers.tolist() == ValidationSet(shards, RECIPE, most=2).numbers.tolist()


def test_nobody_is_in_both_parts(shards):
    own, held_out = split_off(shards, 0.5)
    assert set(own.samples.tolist()) | set(held_out.samples.tolist()) == set(range(5))
    assert not set(shards.person[own.samples]) & set(shards.person[held_out.samples])
    assert set(ValidationSet(held_out, RECIPE).numbers.tolist()) == set(held_out.samples.tolist())
