"""How the layers of a sample become bytes in a shard, and back.

A sample's layer is one HDF5 chunk. Smooth layers are stored as what a planar predictor leaves: a value less its left
and upper neighbours plus the one between them, and that as an unsigned number whose lowest bit is the sign. Then come
HDF5's own filters, shuffle and deflate, which every HDF5 library undoes; the bytes are made and unmade here, because
ISA-L does that several times as fast as the zlib inside HDF5 (docs/explanation/storage.md has the figures). Outside its
box a layer is 0 and costs next to nothing, here as in the file.
"""

import cv2
import numpy as np
from isal import isal_zlib
from jaxtyping import Shaped, UInt8
from numpy import ndarray

from pix2face.shards.layers import Layer

# Of ISA-L's 0 to 3. A level also stands in the file, as advice to an HDF5 library that should compress a chunk itself.
DEFLATE_LEVEL = 1
# See `deflate`. ISA-L's fast path takes 16 bytes and more; in the test, 1 to 15 serve alike.
FIRST_BYTES = 8
# Deflate never shrinks more than this; what claims to is no deflate stream.
LARGEST_DEFLATE_RATIO = 1032

Box = tuple[slice, slice]


def pack_layer(
    layer: Layer, steps: Shaped[ndarray, "y x *c"], box: Box, size_px: tuple[int, int], *, is_predicted: bool
) -> bytes:
    """A layer as HDF5's shuffle and deflate filters would store it.

    It holds ``steps`` in the box and 0 outside; ``size_px`` is height and width of the whole. With ``is_predicted``,
    what the predictor leaves is stored.
    """
    height, width = size_px
    if is_predicted:
        steps = predict(steps)
        # The predictor also leaves something below and to the right of the box, but not outside the picture.
        box = slice(box[0].start, min(box[0].stop + 1, height)), slice(box[1].start, min(box[1].stop + 1, width))
        steps = steps[: box[0].stop - box[0].start, : box[1].stop - box[1].start]
    planes = np.zeros((layer.stored.itemsize, height, width * layer.n_channels), dtype=np.uint8)
    rows = np.ascontiguousarray(steps).reshape(steps.shape[0], steps.shape[1] * layer.n_channels)
    for place, plane in enumerate(_byte_planes(rows)):
        planes[place, box[0], _columns(layer, box)] = plane
    return deflate(planes.reshape(-1))


def unpack_layer(
    layer: Layer, packed: bytes, box: Box, size_px: tuple[int, int], *, is_predicted: bool
) -> Shaped[ndarray, "y x *c"]:
    """What ``pack_layer`` packed, in the box. Makes no more bytes than the layer has or ``packed`` can hold.

    Raises:
        ValueError: The bytes are no such stream, or of another length.
    """
    height, width = size_px
    raw = inflate(packed, height * width * layer.n_channels * layer.stored.itemsize)
    planes = np.frombuffer(raw, dtype=np.uint8).reshape(-1, height, width * layer.n_channels)
    rows = _from_byte_planes(planes[:, box[0], _columns(layer, box)])
    steps = rows.reshape(layer.shape(*(side.stop - side.start for side in box)))
    return undo_prediction(steps) if is_predicted else steps.view(layer.stored)


def deflate(raw: UInt8[ndarray, " n"]) -> bytes:
    """A zlib stream that depends on nothing but the bytes; its first few are a block of their own.

    ISA-L's fast path enters the third position of a stream under the hash of a register that nothing has set: it holds
    the address of the stack (``igzip_icf_body_h1_gr_bt.asm``, ``.write_first_byte``). What it finds there later decodes
    to the same bytes, but now and then a stream is not the one that another process makes, and shards are to be the
    same byte for byte. A block too short for the fast path takes another one, and costs some ten bytes.
    """
    stream = isal_zlib.compressobj(DEFLATE_LEVEL)
    first = stream.compress(raw[:FIRST_BYTES]) + stream.flush(isal_zlib.Z_SYNC_FLUSH)
    return bytes(first + stream.compress(raw[FIRST_BYTES:]) + stream.flush())


def inflate(packed: bytes, n_bytes: int) -> bytes:
    """Undoes deflate, and makes no more than n bytes.

    Raises:
        ValueError: The bytes are no such stream, or of another length.
    """
    if n_bytes > LARGEST_DEFLATE_RATIO * (len(packed) + 1):
        raise ValueError(f"expected a layer of {n_bytes} bytes, found {len(packed)} compressed ones: too few")
    try:
        stream = isal_zlib.decompressobj()
        raw = bytes(stream.decompress(packed, n_bytes + 1))
    except isal_zlib.error as error:  # type: ignore[misc] # the stub says it is a value
        raise ValueError(f"expected a compressed layer, found damaged bytes ({error})") from error
    if len(raw) != n_bytes or not stream.eof:
        raise ValueError(f"expected a layer of {n_bytes} bytes, found {len(raw)}")
    return raw


def undo_prediction(residual: Shaped[ndarray, "y x *c"]) -> Shaped[ndarray, "y x *c"]:
    """Undoes the predictor: signs first, then sums over rows and columns.

    Sums are taken modulo 2 to the number of bits, as the differences were; float64 holds them all exactly.
    """
    signed = _from_zigzag(residual)
    if not residual.size:
        return signed
    exact = np.float32 if residual.itemsize <= 2 else np.float64
    # Five times as fast as two calls of cumsum.
    sums = cv2.integral(signed.astype(exact), sdepth=cv2.CV_64F)[1:, 1:]
    with np.errstate(invalid="ignore"):  # damaged numbers may add up to anything; their checksum will differ
        return sums.astype(np.int32 if signed.itemsize <= 2 else np.int64).astype(signed.dtype).reshape(signed.shape)


def predict(steps: Shaped[ndarray, "y x *c"]) -> Shaped[ndarray, "yy xx *c"]:
    """What the predictor leaves of a box in a background of 0: one row and one column more than the box."""
    edged = np.zeros((steps.shape[0] + 2, steps.shape[1] + 2, *steps.shape[2:]), dtype=steps.dtype)
    edged[1:-1, 1:-1] = steps
    down = edged[1:] - edged[:-1]
    return _to_zigzag(down[:, 1:] - down[:, :-1])


def _to_zigzag(signed: Shaped[ndarray, "*shape"]) -> Shaped[ndarray, "*shape"]:
    """0, -1, 1, -2, ... to 0, 1, 2, 3, ...: small numbers of either sign have no bits in their upper byte."""
    return ((signed << 1) ^ (signed >> (8 * signed.itemsize - 1))).view(f"<u{signed.itemsize}")


def _from_zigzag(unsigned: Shaped[ndarray, "*shape"]) -> Shaped[ndarray, "*shape"]:
    return ((unsigned >> 1) ^ -(unsigned & 1)).view(f"<i{unsigned.itemsize}")


def _columns(layer: Layer, box: Box) -> slice:
    return slice(box[1].start * layer.n_channels, box[1].stop * layer.n_channels)


def _byte_planes(rows: Shaped[ndarray, "y x"]) -> list[UInt8[ndarray, "y x"]]:
    """HDF5's shuffle filter: all first bytes, all second bytes, and so on."""
    if rows.itemsize == 1 or not rows.size:
        return [np.zeros(rows.shape, np.uint8) if rows.itemsize > 1 else rows.view(np.uint8)] * rows.itemsize
    return list(cv2.split(rows.view(np.uint8).reshape(*rows.shape, rows.itemsize)))


def _from_byte_planes(planes: UInt8[ndarray, "b y x"]) -> Shaped[ndarray, "y x"]:
    values = planes[-1].astype(f"<u{len(planes)}")
    for plane in planes[-2::-1]:
        values <<= 8
        values |= plane
    return values
