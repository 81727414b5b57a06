import time
from dataclasses import replace

import pytest
import torch

from pix2face.errors import InputFileError, UsageError
from tests.training.conftest import copy_with_a_damaged_sample
from tests.training.data.test_dataset import RECIPE, assert_same
from training.data.batches import Batch
from training.data.dataset import DrawDataset
from training.data.loader import DrawLoader
from training.data.shard_index import index_shards


@pytest.fixture
def shards(shards_dir):
    return index_shards([shards_dir])


def loader_of(shards, recipe=RECIPE, workers=0, **more):
    return DrawLoader(DrawDataset(shards, recipe, 10**7 if workers else 0), recipe.batch_size, workers=workers, **more)


def joined(batches: list[Batch]) -> Batch:
    return Batch(
        **{
            name: torch.cat([getattr(batch, name) for batch in batches])
            for name in ("image", "pncc", "offset", "mask", "landmarks2d")
        },
        seen=None,
    )


@pytest.mark.usefixtures("measured_processes")
def test_worker_processes_and_their_cache_change_nothing(shards):
    alone = loader_of(shards)
    shared = loader_of(shards, workers=2)
    expected, found = (joined(list(loader.batches(12, 10))) for loader in (alone, shared))
    assert len(expected) == 20
    assert_same(expected, found)


def test_a_training_goes_on_at_any_draw(shards):
    loader = loader_of(shards)
    whole = joined(list(loader.batches(0, 6)))
    assert_same(whole[6:12], joined(list(loader.batches(6, 3))))


def test_machines_share_the_batches_of_one(shards):
    recipe = replace(RECIPE, batch_size=4)
    whole = list(loader_of(shards, recipe).batches(8, 2))
    parts = [list(loader_of(shards, recipe, rank=rank, n_ranks=2).batches(8, 2)) for rank in range(2)]
    for batch in range(2):
        assert_same(whole[batch], joined([parts[0][batch], parts[1][batch]]))
    with pytest.raises(UsageError, match="3 processes can share, found 4 pictures a batch"):
        loader_of(shards, recipe, rank=0, n_ranks=3)


def test_the_time_that_the_trainer_waits_is_counted_and_its_own_is_not(shards):
    loader = loader_of(shards)
    began = time.perf_counter()
    for _ in loader.batches(0, 3):
        time.sleep(0.1)
    assert 0 < loader.wait_seconds <= time.perf_counter() - began - 0.3


@pytest.mark.parametrize("workers", [0, 1])
def test_a_damaged_sample_is_named_in_one_line(shards_dir, tmp_path, workers):
    copy_with_a_damaged_sample(shards_dir, tmp_path / "shards")
    loader = loader_of(index_shards([tmp_path / "shards"]), workers=workers)
    with pytest.raises(
        InputFileError, match=r"^[^\n]*shard-000001\.h5: sample 'head-004' is damaged \([^\n]*`datagen v[^\n]*$"
    ):
        list(loader.batches(0, 5))
