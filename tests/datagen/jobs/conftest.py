"""A job that nothing happens to, run once for all tests that disturb others like it."""

import pytest

from pix2face.shards.shard_checks import verify_shard
from pix2face.shards.shard_reader import ShardReader
from tests.datagen.job_runs import N_FACES, Inputs, content, finished_shards, make_inputs


@pytest.fixture(scope="session")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Inputs:
    return make_inputs(tmp_path_factory.mktemp("inputs"))


@pytest.fixture(scope="session")
def undisturbed(inputs: Inputs, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """Every file of a run on one worker."""
    out = tmp_path_factory.mktemp("undisturbed")
    inputs.run(out, workers=1)
    ids = []
    for path in finished_shards(out):
        assert verify_shard(path) == []
        reader = ShardReader(path)
        ids += reader.sample_ids
    assert len(ids) == len(set(ids)) == N_FACES - 1
    return content(out)
