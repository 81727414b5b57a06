import os
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from pix2face.shards.sample_spans import ShardSpans, find_spans
from pix2face.shards.shard_reader import ShardReader
from pix2face.shards.shard_writing import write_shard
from tests.synthetic_models import small_head_model
from tests.training.conftest import head_triplet, shard_header

LAYERS = ("pncc", "offset", "mask")


def spans_of(path: Path) -> ShardSpans | None:
    with ShardReader(path) as reader:
        return find_spans(reader)


def reads(path: Path):
    descriptor = os.open(path, os.O_RDONLY)
    return lambda start, n_bytes: os.pread(descriptor, n_bytes, start)


@pytest.mark.parametrize("compression", ["deflate", "plain"])
def test_what_is_read_is_what_the_hdf5_library_reads(tmp_path, compression):
    model, path = small_head_model(), tmp_path / "shard-00000.h5"
    write_shard(path, shard_header(model), [head_triplet(model, seed) for seed in range(3)], compression)
    spans = spans_of(path)
    with ShardReader(path) as reader:
        for index in range(3):
            found = spans.sample(index, LAYERS, reads(path), is_checked=True)
            top, left, bottom, right = reader.box_px(index)
            assert found.image == reader.image_bytes(index)
            assert found.corner == (left, top)
            assert np.array_equal(found.landmarks2d, reader.landmarks2d(index))
            for name in LAYERS:
                assert np.array_equal(found.steps[name], reader.stored_layer(index, name)[top:bottom, left:right])


def test_layers_that_are_not_wanted_are_checked_all_the_same(tmp_path):
    model, path = small_head_model(), tmp_path / "shard-00000.h5"
    write_shard(path, shard_header(model), [head_triplet(model, 0)])
    spans = spans_of(path)
    assert list(spans.sample(0, ("mask",), reads(path), is_checked=True).steps) == ["mask"]
    wrong = replace(spans, checksums=spans.checksums + np.uint32(1))
    wrong.sample(0, ("mask",), reads(path), is_checked=False)
    with pytest.raises(ValueError, match="checksum differs"):
        wrong.sample(0, ("mask",), reads(path), is_checked=True)


def test_each_byte_of_a_sample_is_under_a_checksum(tmp_path):
    """Picture, layers, columns and attributes: one bit turned over anywhere in them is found."""
    model, path = small_head_model(), tmp_path / "shard-00000.h5"
    write_shard(path, shard_header(model), [head_triplet(model, 0)])
    spans = spans_of(path)
    places = [
        tuple(spans.images[0].tolist()),
        *(tuple(span) for span in spans.chunks[0].tolist()),
        *spans.columns.values(),
    ]
    rng, sound = np.random.default_rng(0), path.read_bytes()
    for start, length in places:
        for _ in range(3):
            content = bytearray(sound)
            content[start + int(rng.integers(length))] ^= 1 << int(rng.integers(8))
            with pytest.raises(ValueError, match=r"checksum differs|damaged bytes|expected a layer"):
                spans.sample(0, LAYERS, lambda a, n, content=content: bytes(content[a : a + n]), is_checked=True)
    spans.sample(0, LAYERS, lambda a, n: sound[a : a + n], is_checked=True)


def test_what_only_the_hdf5_library_can_read_has_no_spans(tmp_path):
    model, path = small_head_model(), tmp_path / "shard-00000.h5"
    write_shard(path, shard_header(model), [head_triplet(model, 0)])
    with h5py.File(path, "r+") as file:
        steps = file["mask"][()]
        attributes = dict(file["mask"].attrs)
        del file["mask"]
        file.create_dataset("mask", data=steps, chunks=(1, *steps.shape[1:])).attrs.update(attributes)
    assert spans_of(path) is None
    write_shard(tmp_path / "empty.h5", shard_header(model), [])
    assert spans_of(tmp_path / "empty.h5") is None
