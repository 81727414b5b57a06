import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from pix2face.errors import InputFileError
from pix2face.shards.shard_writing import write_shard
from tests.synthetic_models import small_head_model
from tests.training.conftest import head_triplet, shard_header
from training.data import sample_files
from training.data.decoded_sample import TRAINED_LAYERS
from training.data.sample_files import SampleFiles
from training.data.shard_index import index_shards

OPEN_FILES = Path("/proc/self/fd")


def files_of(index) -> SampleFiles:
    return SampleFiles(index.paths, index.spans, TRAINED_LAYERS)


def n_open_files() -> int:
    return len(list(OPEN_FILES.iterdir()))


@pytest.mark.skipif(not OPEN_FILES.is_dir(), reason="counts open files by /proc")
@pytest.mark.parametrize("has_spans", [True, False])
def test_few_files_are_open_however_many_shards_there_are(tmp_path, monkeypatch, has_spans):
    monkeypatch.setattr(sample_files, "MOST_OPEN_FILES", 3)
    monkeypatch.setattr(sample_files, "MOST_OPEN_READERS", 3)
    model = small_head_model()
    for number in range(8):
        write_shard(tmp_path / f"shard-{number:05d}.h5", shard_header(model), [head_triplet(model, number)])
    index = index_shards([tmp_path])
    files = SampleFiles(index.paths, index.spans if has_spans else [None] * 8, TRAINED_LAYERS)
    before = n_open_files()
    pictures = {files.read(shard, 0).image for _ in range(3) for shard in range(8)}
    assert len(pictures) == 8
    assert n_open_files() - before == 3
    files.close()
    assert n_open_files() == before
    assert files.read(5, 0).image in pictures
    files.close()


def test_the_hdf5_library_reads_the_same(shards_dir):
    index = index_shards([shards_dir])
    direct, by_library = files_of(index), SampleFiles(index.paths, [None, None], TRAINED_LAYERS)
    for shard, position in zip(index.shard.tolist(), index.position.tolist(), strict=True):
        found, expected = direct.read(shard, position), by_library.read(shard, position)
        assert found.image == expected.image
        assert found.corner == expected.corner
        assert np.array_equal(found.landmarks2d, expected.landmarks2d)
        assert found.steps.keys() == expected.steps.keys() == {"pncc", "offset", "mask"}
        for name in found.steps:
            assert np.array_equal(found.steps[name], expected.steps[name])


@pytest.mark.parametrize("has_spans", [True, False])
@pytest.mark.parametrize("column", ["image_bytes", "identity"])
def test_a_changed_byte_is_found_and_its_sample_named(shards_dir, tmp_path, has_spans, column):
    shutil.copytree(shards_dir, tmp_path / "s")
    path = tmp_path / "s" / "shard-000000.h5"
    with h5py.File(path, "r") as file:
        start = file[column].id.get_offset()
    index = index_shards([tmp_path / "s"])
    content = bytearray(path.read_bytes())
    content[start + 60] ^= 1
    path.write_bytes(content)
    files = SampleFiles(index.paths, index.spans if has_spans else [None, None], TRAINED_LAYERS)
    with pytest.raises(InputFileError, match=r"shard-000000\.h5: sample 'head-00[0-2]' is damaged .*datagen verify"):
        [files.read(0, position) for position in range(3)]
    files.read(1, 0)


def test_a_shard_that_is_gone_is_said(shards_dir, tmp_path):
    shutil.copytree(shards_dir, tmp_path / "s")
    files = files_of(index_shards([tmp_path / "s"]))
    (tmp_path / "s" / "shard-000001.h5").unlink()
    with pytest.raises(InputFileError, match=r"shard-000001\.h5: sample number 1 is damaged .*No such file"):
        files.read(1, 1)


def test_it_is_checked_when_first_read_alone(shards_dir, monkeypatch):
    index = index_shards([shards_dir])
    files, checked = files_of(index), []
    original = type(index.spans[0]).sample
    monkeypatch.setattr(
        type(index.spans[0]),
        "sample",
        lambda self, *arguments, is_checked: (
            checked.append(is_checked) or original(self, *arguments, is_checked=is_checked)
        ),
    )
    for _ in range(3):
        files.read(0, 1)
    assert checked == [True, False, False]
