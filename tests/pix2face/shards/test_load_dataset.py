"""Folders of shards in the library ``datasets`` of Hugging Face, by its own reader of HDF5."""

from dataclasses import replace
from pathlib import Path

import datasets
import numpy as np
import pytest

from pix2face.files.images import decode_image, encode_photograph
from pix2face.shards.shard_reader import ShardReader, shard_paths
from pix2face.shards.shard_writing import write_shard
from tests.pix2face.shard_files import HEADER, make_triplet


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two shards whose pictures and texts are of other lengths."""
    short = encode_photograph(np.full((24, 24, 3), 90, np.uint8))
    grey = replace(make_triplet(3), sample_id="a longer name", image_bytes=short)
    write_shard(tmp_path / "shards" / "shard-00000.h5", HEADER, [make_triplet(0), make_triplet(1)])
    write_shard(tmp_path / "shards" / "shard-00001.h5", HEADER, [make_triplet(2), grey, make_triplet(4)])
    return tmp_path / "shards"


def load(folder: Path) -> datasets.Dataset:
    files = [str(path) for path in shard_paths(folder)]
    return datasets.load_dataset("hdf5", data_files=files, split="train", cache_dir=str(folder / "cache"))


def test_load_dataset_reads_a_folder_of_shards(folder: Path) -> None:
    rows = load(folder)
    samples = [ShardReader(path).read(index) for path in shard_paths(folder) for index in range(len(ShardReader(path)))]
    assert len(rows) == len(samples) == 5
    for row, expected in zip(rows, samples, strict=True):
        assert row["sample_id"] == expected.sample_id.encode()
        assert bytes(row["image"][: row["image_length"]]) == expected.image_bytes
        np.testing.assert_array_equal(decode_image(bytes(row["image"]), "test"), expected.image)
        # As docs/reference/file_formats.md says.
        stored = np.array(row["pncc_coded"], "u2")
        signed = ((stored >> 1) ^ -(stored & 1)).view("i2")
        pncc_mm = signed.cumsum(0, dtype="i2").cumsum(1, dtype="i2") / 128
        np.testing.assert_array_equal(pncc_mm.astype(np.float32), expected.maps.pncc)
        np.testing.assert_array_equal(np.array(row["mask"], bool), expected.maps.mask)
        np.testing.assert_array_equal(np.array(row["camera"]), expected.camera.matrix)


def test_load_dataset_reads_plain_values_as_they_are(tmp_path: Path) -> None:
    sample = make_triplet(0)
    write_shard(tmp_path / "shard-00000.h5", HEADER, [sample], is_plain=True)
    (row,) = load(tmp_path)
    for name in ("pncc", "offset", "depth"):
        np.testing.assert_allclose(np.array(row[name], np.float32), sample.layers[name], atol=0.5 / 128 + 1e-4)
