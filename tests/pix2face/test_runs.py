"""The last checkpoint is found, or the line that trains one is shown."""

import os

import pytest

from pix2face.errors import UsageError
from pix2face.runs import latest_checkpoint


def test_the_checkpoint_written_last_is_taken(tmp_path):
    for age, run in ((30, "first"), (10, "last"), (20, "middle")):
        path = tmp_path / run / "checkpoint.safetensors"
        path.parent.mkdir()
        path.touch()
        os.utime(path, (1e9 - age, 1e9 - age))
    assert latest_checkpoint(tmp_path) == tmp_path / "last" / "checkpoint.safetensors"


@pytest.mark.parametrize("exists", [True, False])
def test_without_a_checkpoint_the_message_shows_how_to_train(tmp_path, exists):
    folder = tmp_path if exists else tmp_path / "runs"
    with pytest.raises(UsageError, match="train --shards") as caught:
        latest_checkpoint(folder)
    assert "--checkpoint" in str(caught.value)
