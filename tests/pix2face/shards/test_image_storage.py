"""Pictures as rows of a dataset: any inflater reads them, and what follows them is zeros."""

import zlib

import numpy as np
import pytest

from pix2face.shards.image_storage import SHORTEST_ROW_BYTES, pack_image, row_length, unpack_image

LENGTHS = (1, 7, 1000, 65534, 65535, 65536, 140_000)


def noise(length: int) -> bytes:
    return np.random.default_rng(length).bytes(length)


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("n_padding", [0, 1, 9, 300_000])
def test_any_inflater_reads_a_packed_picture(length: int, n_padding: int) -> None:
    image = noise(length)
    packed = pack_image(image, length + n_padding)
    assert zlib.decompress(packed) == image + bytes(n_padding)
    assert len(packed) < length + 500
    for is_whole in (False, True):
        assert unpack_image(packed, length, length + n_padding, is_whole=is_whole) == image


def test_what_another_program_compressed_is_read() -> None:
    """As h5repack leaves it."""
    image = noise(1000)
    packed = zlib.compress(image + bytes(5000))
    for is_whole in (False, True):
        assert unpack_image(packed, 1000, 6000, is_whole=is_whole) == image


def test_what_is_no_packed_picture_is_refused() -> None:
    image = noise(1000)
    with pytest.raises(ValueError, match="expected zeros behind the picture, found others"):
        unpack_image(zlib.compress(image + b"\0\0\1"), 1000, 1003, is_whole=True)
    with pytest.raises(ValueError, match="expected a picture of 2000 bytes, found 1000"):
        unpack_image(zlib.compress(image), 2000, 3000, is_whole=False)
    for is_whole in (False, True):
        with pytest.raises(ValueError, match="found damaged bytes"):
            unpack_image(b"no stream at all", 1000, 1003, is_whole=is_whole)


def test_rows_are_as_long_as_few_things_require() -> None:
    assert row_length([noise(10)], (0, 0)) == SHORTEST_ROW_BYTES
    assert row_length([noise(10), noise(60_000)], (256, 256)) == 65536
    assert row_length([noise(65537)], (256, 256)) == 2 * 65536
    assert row_length([], (256, 256)) == 65536
