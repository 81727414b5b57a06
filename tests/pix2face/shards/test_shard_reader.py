"""Reading samples from their places in the file: as the HDF5 library reads them, checked, in any process."""

import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from pix2face.errors import InputFileError, UsageError
from pix2face.shards.shard_layout import CONTENT_COLUMNS
from pix2face.shards.shard_reader import ShardReader
from pix2face.shards.shard_writing import write_shard
from tests.pix2face.shard_files import HEADER, as_earlier_versions_stored, every_layer, make_triplet

EVERYTHING = ("image", "pncc", "offset", "mask", *CONTENT_COLUMNS, "attributes", "sample_id", "box_px", "checksum")
OPEN_FILES = Path("/proc/self/fd")


@pytest.fixture
def shard(tmp_path: Path) -> Path:
    """Three samples of two sizes."""
    path = tmp_path / "shard-00000.h5"
    write_shard(path, HEADER, [make_triplet(0), make_triplet(1, 31), make_triplet(2)])
    return path


def chunked_columns(path: Path) -> None:
    """As h5repack or other programs may leave a shard: its rows are no longer one after the other."""
    with h5py.File(path, "r+") as file:
        for name in (*CONTENT_COLUMNS, "sample_id", "attributes", "image", "mask"):
            values, attributes = file[name][()], dict(file[name].attrs)
            del file[name]
            file.create_dataset(name, data=values, chunks=(1, *values.shape[1:])).attrs.update(attributes)


@pytest.mark.parametrize("change", ["deflate", "plain", "zstd", "chunked"])
def test_what_is_read_from_its_place_is_what_the_hdf5_library_reads(shard: Path, change: str) -> None:
    expected = ShardReader(shard)
    wanted = [expected.stored(index, EVERYTHING, is_checked=True) for index in range(3)]
    columns = {name: expected.column(name) for name in (*CONTENT_COLUMNS, "attributes")}
    if change == "chunked":
        chunked_columns(shard)
    else:
        as_earlier_versions_stored(shard, change)
    found = ShardReader(shard)
    for index in range(3):
        stored = found.stored(index, EVERYTHING, is_checked=True)
        assert stored.keys() == wanted[index].keys()
        for name in EVERYTHING:
            np.testing.assert_array_equal(stored[name], wanted[index][name], strict=True)
    for name, values in columns.items():
        np.testing.assert_array_equal(found.column(name), values)


def test_layers_that_are_not_wanted_are_checked_all_the_same(shard: Path) -> None:
    assert list(ShardReader(shard).stored(0, ("mask",), is_checked=True)) == ["mask"]
    with h5py.File(shard, "r+") as file:
        file["identity"][0, 0] += 1
    reader = ShardReader(shard)
    reader.stored(0, ("mask",))
    with pytest.raises(InputFileError, match=r"sample 'face/0' is damaged \(the checksum differs"):
        reader.stored(0, ("mask",), is_checked=True)
    reader.stored(1, ("mask",), is_checked=True)


def test_each_byte_of_a_sample_is_under_a_checksum(shard: Path) -> None:
    """Picture, layers, columns and attributes: one bit turned over anywhere in them is found."""
    reader, places = ShardReader(shard), []
    with h5py.File(shard) as file:
        for name in ("pncc_coded", "offset_coded", "mask", "depth_coded"):
            chunk = file[name].id.get_chunk_info(1)
            places.append((chunk.byte_offset, chunk.size))
        for name in (*CONTENT_COLUMNS, "attributes"):
            length = file[name][1].nbytes
            places.append((file[name].id.get_offset() + length, length))
        places.append((file["image"].id.get_chunk_info(1).byte_offset, int(file["image_length"][1])))
    rng, sound = np.random.default_rng(0), shard.read_bytes()
    for start, length in places:
        for _ in range(3):
            content = bytearray(sound)
            content[start + int(rng.integers(length))] ^= 1 << int(rng.integers(8))
            shard.write_bytes(content)
            with pytest.raises(InputFileError, match=r"'face/1' is damaged .*datagen verify .* lists all damage"):
                reader.stored(1, ("mask",), is_checked=True)
            reader.stored(0, ("mask",), is_checked=True)
    shard.write_bytes(sound)
    reader.stored(1, ("mask",), is_checked=True)


def test_a_shard_that_is_gone_and_a_place_beyond_the_last_are_said(shard: Path) -> None:
    reader = ShardReader(shard)
    for index in (3, -1):
        with pytest.raises(IndexError, match=f"expected a place below 3, found {index}"):
            reader.read(index)
    shard.unlink()
    with pytest.raises(InputFileError, match=r"shard-00000\.h5: sample number 1 is damaged .*No such file"):
        reader.read(1)
    with pytest.raises(InputFileError, match=r"shard-00000\.h5: expected a shard, found no such file"):
        ShardReader(shard)


@pytest.mark.skipif(not OPEN_FILES.is_dir(), reason="counts open files by /proc")
@pytest.mark.parametrize("compression", ["deflate", "zstd"])
def test_no_file_stays_open(shard: Path, compression: str) -> None:
    if compression == "zstd":
        as_earlier_versions_stored(shard, compression)
    before = len(list(OPEN_FILES.iterdir()))
    reader = ShardReader(shard)
    samples = [reader.read(index) for index in range(3)]
    assert len(list(OPEN_FILES.iterdir())) == before
    assert len({sample.image_bytes for sample in samples}) == 3


def test_only_layers_that_are_asked_for_are_read(tmp_path: Path) -> None:
    path = tmp_path / "shard-00000.h5"
    write_shard(path, *every_layer(2))
    sample = ShardReader(path).read(1, ("uv", "landmarks"))
    assert (sample.image_bytes, list(sample.layers)) == (None, ["uv"])
    assert len(sample.landmarks2d) == 68


def test_a_missing_filter_says_what_to_install(shard: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    as_earlier_versions_stored(shard, "zstd")
    monkeypatch.setattr(h5py.h5z, "filter_avail", lambda code: code < 256)
    monkeypatch.setitem(sys.modules, "hdf5plugin", None)
    with pytest.raises(UsageError, match=r"hdf5plugin .* not installed; pip install 'pix2face\[storage\]'"):
        ShardReader(shard)
