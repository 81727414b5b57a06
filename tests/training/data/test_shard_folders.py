from pathlib import Path

import pytest

from pix2face.errors import UsageError
from training.data.shard_folders import ShardFolder, parse_shard_folders


def test_folders_and_weights():
    assert parse_shard_folders(["a/", "b"]) == [ShardFolder(Path("a")), ShardFolder(Path("b"))]
    assert parse_shard_folders(["a/:0.7", "b:3e-1"]) == [ShardFolder(Path("a"), 0.7), ShardFolder(Path("b"), 0.3)]
    assert parse_shard_folders(["a:b"]) == [ShardFolder(Path("a:b"))]


def test_a_folder_whose_name_ends_like_a_weight_is_a_folder(tmp_path):
    (tmp_path / "set:2").mkdir()
    assert parse_shard_folders([str(tmp_path / "set:2")]) == [ShardFolder(tmp_path / "set:2")]
    assert parse_shard_folders([str(tmp_path / "set:2:5")]) == [ShardFolder(tmp_path / "set:2", 5.0)]


@pytest.mark.parametrize(
    ("texts", "message"),
    [
        (["a:0"], "--shards a:0: expected a weight above 0, found 0"),
        (["a:-1"], "expected a weight above 0, found -1"),
        (["a:nan"], "expected a weight above 0, found nan"),
        (["a:inf"], "expected a weight above 0, found inf"),
        (["a:0.5", "b"], "expected a weight for every folder or for none, found none for b; write b:0.5"),
    ],
)
def test_wrong_weights_are_refused(texts, message):
    with pytest.raises(UsageError, match=message):
        parse_shard_folders(texts)
