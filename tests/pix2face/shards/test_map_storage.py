"""Layers to bytes and back: exactly, in any box, and as HDF5's own filters read them."""

import threading
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.shards.layers import LAYERS, Layer
from pix2face.shards.map_storage import Box, deflate, inflate, pack_layer, predict, undo_prediction, unpack_layer

SMOOTH = [layer for layer in LAYERS.values() if layer.is_smooth]


def any_steps(layer: Layer, shape: tuple[int, int], seed: int) -> np.ndarray:
    """Of the whole range that the layer's type has: differences do not fit it."""
    limits = np.iinfo(layer.stored)
    values = np.random.default_rng(seed).integers(limits.min, limits.max, layer.shape(*shape), np.int64, endpoint=True)
    return values.astype(layer.stored)


@st.composite
def boxes(draw: st.DrawFn) -> tuple[tuple[int, int], Box]:
    """A picture and a box in it, which may be empty and may touch every border."""
    height, width = draw(st.integers(1, 30)), draw(st.integers(1, 30))
    top, bottom = sorted(draw(st.tuples(st.integers(0, height), st.integers(0, height))))
    left, right = sorted(draw(st.tuples(st.integers(0, width), st.integers(0, width))))
    return (height, width), (slice(top, bottom), slice(left, right))


@given(st.sampled_from(list(LAYERS.values())), boxes(), st.booleans(), st.integers(0, 99))
def test_what_is_packed_is_unpacked_exactly(
    layer: Layer, picture: tuple[tuple[int, int], Box], predicted: bool, seed: int
) -> None:
    size_px, box = picture
    predicted = predicted and layer.is_smooth
    whole = np.zeros(layer.shape(*size_px), layer.stored)
    whole[box] = any_steps(layer, whole[box].shape[:2], seed)
    packed = pack_layer(layer, whole[box], box, size_px, is_predicted=predicted)
    in_box = unpack_layer(layer, packed, box, size_px, is_predicted=predicted)
    everything = slice(0, size_px[0]), slice(0, size_px[1])
    unpacked = unpack_layer(layer, packed, everything, size_px, is_predicted=predicted)
    np.testing.assert_array_equal(in_box, whole[box], strict=True)
    np.testing.assert_array_equal(unpacked, whole, strict=True)


@given(st.sampled_from(SMOOTH), st.integers(1, 20), st.integers(1, 20), st.integers(0, 99))
def test_two_lines_of_numpy_undo_the_predictor(layer: Layer, height: int, width: int, seed: int) -> None:
    """As docs/reference/file_formats.md gives them."""
    steps = any_steps(layer, (height, width), seed)
    stored = predict(steps)[:height, :width]
    signed = ((stored >> 1) ^ -(stored & 1)).view(steps.dtype)
    values = signed.cumsum(0, dtype=signed.dtype).cumsum(1, dtype=signed.dtype)
    np.testing.assert_array_equal(values, steps)
    np.testing.assert_array_equal(undo_prediction(stored), steps)


def test_a_plane_is_predicted_but_for_its_borders() -> None:
    rows, columns = np.mgrid[0:9, 0:12]
    plane = (500 + 3 * rows - 7 * columns).astype("<i2")
    left = predict(plane[..., None])[1:9, 1:12]
    assert not left.any()


def test_a_chunk_is_what_zlib_and_a_shuffle_give() -> None:
    layer, steps = LAYERS["pncc"], any_steps(LAYERS["pncc"], (5, 7), 0)
    packed = pack_layer(layer, steps, np.s_[0:5, 0:7], (5, 7), is_predicted=False)
    raw = zlib.decompress(packed)
    assert raw[: len(raw) // 2] == steps.tobytes()[::2]  # all lower bytes, then all upper ones
    assert raw[len(raw) // 2 :] == steps.tobytes()[1::2]


@pytest.mark.parametrize("packed", [b"", b"no deflate", zlib.compress(bytes(99)), zlib.compress(bytes(101))])
def test_damaged_bytes_are_refused(packed: bytes) -> None:
    with pytest.raises(ValueError, match="expected a"):
        inflate(packed, 100)


def test_a_cut_stream_is_refused() -> None:
    packed = zlib.compress(np.random.default_rng(0).bytes(1000))
    with pytest.raises(ValueError, match="expected a"):
        inflate(packed[:-1], 1000)


def test_a_changed_bit_is_noticed_by_the_streams_own_checksum() -> None:
    packed = bytearray(zlib.compress(np.random.default_rng(0).bytes(1000), 0))
    packed[500] ^= 1
    with pytest.raises(ValueError, match="expected a compressed layer"):
        inflate(bytes(packed), 1000)


def test_no_more_is_made_than_the_bytes_can_hold() -> None:
    """A declared size alone must not cost memory."""
    with pytest.raises(ValueError, match="too few"):
        inflate(zlib.compress(bytes(100)), 1 << 40)


def test_bytes_do_not_depend_on_where_the_stack_lies() -> None:
    """Runs of zeros between noise are what ISA-L's own one call goes wrong at, on about one stack in forty here."""
    raws = np.zeros((10, 46, 700), np.uint8)
    raws[:, :, 400:] = np.random.default_rng(0).integers(1, 256, (10, 46, 300))
    found: set[tuple[bytes, ...]] = set()
    before = threading.stack_size()
    try:
        for size in np.random.default_rng(1).integers(4, 4000, 600):
            threading.stack_size(65536 * int(size))
            thread = threading.Thread(target=lambda: found.add(tuple(deflate(raw.reshape(-1)) for raw in raws)))
            thread.start()
            thread.join()
    finally:
        threading.stack_size(before)
    assert len(found) == 1
    assert [zlib.decompress(packed) for packed in found.pop()] == [raw.tobytes() for raw in raws]
