"""``datagen verify --upgrade``: shards of schema 2 become shards of schema 3 with the same samples."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from datagen.cli import main
from datagen.jobs.folder_lock import job_lock
from datagen.jobs.shard_upgrade import upgrade_folder, upgrade_shard
from pix2face.errors import InputFileError, UsageError
from pix2face.shards.shard_checks import verify_shard
from pix2face.shards.shard_reader import ShardReader
from pix2face.shards.shard_writing import write_shard
from tests.pix2face.shard_files import as_earlier_versions_stored, every_layer

SCHEMA_2 = Path(__file__).parents[2] / "pix2face" / "shards" / "schema_2.h5"


@pytest.fixture
def shard(tmp_path: Path) -> Path:
    """As the last version that wrote schema 2 left it."""
    return shutil.copy(SCHEMA_2, tmp_path / "shard-00000.h5")


def assert_same(path: Path, before: Path) -> None:
    found, expected = ShardReader(path), ShardReader(before)
    assert (found.is_current, expected.is_current) == (True, False)
    assert found.header == expected.header
    np.testing.assert_array_equal(found.column("checksum"), expected.column("checksum"))
    for index in range(len(expected)):
        sample, old = found.read(index), expected.read(index)
        assert (sample.sample_id, sample.image_bytes, sample.attributes) == (
            old.sample_id,
            old.image_bytes,
            old.attributes,
        )
        for name, values in old.layers.items():
            np.testing.assert_array_equal(sample.layers[name], values, strict=True)
    assert verify_shard(path) == []


def test_a_file_of_the_earlier_version_is_converted(shard: Path) -> None:
    upgrade_shard(shard)
    assert_same(shard, SCHEMA_2)


@pytest.mark.parametrize("compression", ["plain", "zstd"])
def test_every_earlier_compression_is_converted(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, *every_layer(2))
    as_earlier_versions_stored(path, compression)
    before = shutil.copy(path, tmp_path / "before.h5")
    upgrade_shard(path)
    assert ShardReader(path).is_plain == (compression == "plain")
    assert_same(path, before)


def test_the_command_converts_once_and_says_so(shard: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(shard.parent)
    assert main(["verify", folder]) == 0
    assert "1 shard of an earlier schema" in capsys.readouterr().err
    assert shard.read_bytes() == SCHEMA_2.read_bytes()
    assert main(["verify", "--upgrade", folder]) == 0
    out, error = capsys.readouterr()
    assert "1 shard of an earlier schema converted" in error
    assert out == "1 shard, 2 samples: no problem found\n"
    assert "pncc_coded" in (shard.parent / "dataset_card.md").read_text(encoding="utf-8")
    content = shard.read_bytes()
    assert main(["verify", "--upgrade", folder]) == 0
    assert "0 shards of an earlier schema converted" in capsys.readouterr().err
    assert shard.read_bytes() == content


@pytest.mark.parametrize("kind", [KeyboardInterrupt, OSError])
def test_an_interruption_leaves_the_old_shard_and_nothing_else(
    shard: Path, kind: type[BaseException], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise kind

    with monkeypatch.context() as patched:
        patched.setattr(Path, "replace", interrupted)
        with pytest.raises((kind, UsageError)):
            upgrade_folder(shard.parent)
    assert [path.name for path in shard.parent.iterdir()] == [shard.name]
    assert shard.read_bytes() == SCHEMA_2.read_bytes()
    (shard.parent / ".shard-00000.h5.0123456789ab.part").write_bytes(b"as kill -9 leaves it")
    assert upgrade_folder(shard.parent) == 1
    assert not list(shard.parent.glob(".*"))


def test_a_damaged_shard_stays_and_is_named(shard: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sound = shutil.copy(shard, shard.with_name("shard-00001.h5"))
    content = bytearray(shard.read_bytes())
    place = content.index(b"\x89PNG") + 900
    content[place] ^= 1
    shard.write_bytes(content)
    with pytest.raises(InputFileError, match="is damaged"):
        upgrade_shard(shard)
    assert main(["verify", "--upgrade", str(shard.parent)]) == 2
    assert "shard-00000.h5" in capsys.readouterr().out
    assert shard.read_bytes() == bytes(content)
    assert ShardReader(Path(sound)).is_current


def test_a_folder_in_which_a_job_writes_is_refused(shard: Path) -> None:
    with job_lock(shard.parent), pytest.raises(UsageError, match="expected to be the only job that writes there"):
        upgrade_folder(shard.parent)
