import pytest

from pix2face.default_checkpoint import default_checkpoint
from pix2face.errors import UsageError


@pytest.fixture
def trained(tmp_path):
    path = tmp_path / "runs" / "tiny" / "checkpoint.safetensors"
    path.parent.mkdir(parents=True)
    path.touch()
    return path


def test_the_packaged_one_comes_before_any_that_was_trained(tmp_path, trained):
    packaged = tmp_path / "packaged.safetensors"
    packaged.touch()
    assert default_checkpoint(packaged, tmp_path / "runs") == packaged


def test_while_none_is_packaged_the_last_trained_is_taken(tmp_path, trained):
    assert default_checkpoint(tmp_path / "missing.safetensors", tmp_path / "runs") == trained


def test_where_there_is_neither_the_way_out_is_said(tmp_path):
    with pytest.raises(UsageError, match=r"no checkpoint comes with this version.*train --shards") as caught:
        default_checkpoint(tmp_path / "missing.safetensors", tmp_path / "runs")
    assert "--checkpoint" in str(caught.value)
    assert "\n" not in str(caught.value)
