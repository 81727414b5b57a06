"""How the pictures of a shard become bytes in its file, and back.

A picture is an image file of any length. It is one row of the dataset ``image``, followed by zeros: HDF5's arrays of
variable length are not used, because damaged ones can crash the process that reads them. Each row is a chunk, whose
stream contains the image file as it is (in the blocks that deflate calls stored) and the zeros compressed.
"""

from collections.abc import Mapping, Sequence

import h5py
import numpy as np
from isal import isal_zlib

from pix2face.shards.layers import IMAGE
from pix2face.shards.map_storage import DEFLATE_LEVEL, FIRST_BYTES, inflate

# How many bytes of its row a picture takes, or, in schema 2, where it ends in the row of all pictures.
IMAGE_LENGTH, IMAGE_END = "image_length", "image_end"
# Two bytes that start every zlib stream of this kind (RFC 1950), and the most that a stored block holds (RFC 1951).
ZLIB_START = b"\x78\x01"
STORED_BLOCK_BYTES = 65535
# Rows are at least as long as this, also where the size of the pictures is not known.
SHORTEST_ROW_BYTES = 4096


def row_length(images: Sequence[bytes], padded_px: tuple[int, int]) -> int:
    """Length of the rows that hold some image files: a byte for each pixel, doubled until all fit.

    It depends as little as possible on the files, since other programs join shards only if their rows are equally long.
    """
    length, longest = max(padded_px[0] * padded_px[1], SHORTEST_ROW_BYTES), max(map(len, images), default=0)
    while length < longest:
        length *= 2
    return length


def pack_image(image: bytes, n_bytes: int) -> bytes:
    """A row of n bytes as HDF5's deflate filter could store it: an image file, and zeros after it."""
    blocks = [ZLIB_START]
    for start in range(0, len(image), STORED_BLOCK_BYTES):
        part = image[start : start + STORED_BLOCK_BYTES]
        blocks += [_block_head(len(part)), part]
    padding = bytes(n_bytes - len(image))
    # The first bytes are a block of their own, as in `map_storage.deflate`, so that equal rows are equal streams.
    stream = isal_zlib.compressobj(DEFLATE_LEVEL, isal_zlib.DEFLATED, -isal_zlib.MAX_WBITS)
    blocks += [stream.compress(padding[:FIRST_BYTES]), stream.flush(isal_zlib.Z_SYNC_FLUSH)]
    blocks += [stream.compress(padding[FIRST_BYTES:]), stream.flush()]
    return b"".join([*blocks, isal_zlib.adler32(padding, isal_zlib.adler32(image)).to_bytes(4, "big")])


def unpack_image(packed: bytes, length: int, n_bytes: int, *, is_whole: bool) -> bytes:
    """The image file of some length in a row of n bytes that was packed; ``is_whole`` also checks the zeros after it.

    Raises:
        ValueError: The bytes are no such stream, or there is something else behind the image file.
    """
    if is_whole:
        row = inflate(packed, n_bytes)
        if row.count(0, length) < n_bytes - length:
            raise ValueError("expected zeros behind the picture, found others")
        return row[:length]
    if length <= STORED_BLOCK_BYTES and length < len(packed):
        head = ZLIB_START + _block_head(length)
        if packed.startswith(head):  # it stands there as it is: many times as fast
            return packed[len(head) : len(head) + length]
    try:
        image = bytes(isal_zlib.decompressobj().decompress(packed, length))
    except isal_zlib.error as error:  # type: ignore[misc] # the stub says it is a value
        raise ValueError(f"expected a packed picture, found damaged bytes ({error})") from error
    if len(image) < length:
        raise ValueError(f"expected a picture of {length} bytes, found {len(image)}")
    return image


def _block_head(length: int) -> bytes:
    """What precedes a stored block that is not the last (RFC 1951, 3.2.4)."""
    return b"\x00" + length.to_bytes(2, "little") + (STORED_BLOCK_BYTES - length).to_bytes(2, "little")


def check_images(datasets: Mapping[str, h5py.Dataset], n: int) -> None:
    """Checks type and shape of what holds the pictures of n samples.

    Raises:
        ValueError: A dataset is not as this format has it.
    """
    if IMAGE not in datasets:
        _check_images_in_one_row(datasets, n)
        return
    rows, lengths = datasets[IMAGE], datasets[IMAGE_LENGTH]
    if rows.dtype != np.uint8 or rows.ndim != 2 or len(rows) != n or rows.chunks != ((1, rows.shape[1]) if n else None):
        raise ValueError(
            f"{IMAGE} is {rows.dtype} {rows.shape} in chunks of {rows.chunks}, expected a row of bytes each"
        )
    if lengths.dtype != np.dtype("<i4") or lengths.shape != (n,):
        raise ValueError(f"{IMAGE_LENGTH} is {lengths.dtype} {lengths.shape}, expected int32 ({n},)")
    if n and not 0 <= lengths[()].min() <= lengths[()].max() <= rows.shape[1]:
        raise ValueError(f"{IMAGE_LENGTH} exceeds the rows of {IMAGE}")


def _check_images_in_one_row(datasets: Mapping[str, h5py.Dataset], n: int) -> None:
    """In schema 2, all pictures follow each other."""
    content, ends = datasets["image_bytes"], datasets[IMAGE_END]
    if content.dtype != np.uint8 or content.ndim != 1:
        raise ValueError(f"image_bytes is {content.dtype} {content.shape}, expected bytes in one row")
    if ends.dtype != np.dtype("<i8") or ends.shape != (n,):
        raise ValueError(f"{IMAGE_END} is {ends.dtype} {ends.shape}, expected int64 ({n},)")
    if (np.diff(ends[()], prepend=0) < 0).any() or (int(ends[-1]) if n else 0) != len(content):
        raise ValueError(f"{IMAGE_END} does not divide image_bytes")
