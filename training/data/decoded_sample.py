"""A sample as the trainer handles it, and as bytes in the cache that its processes share."""

from dataclasses import dataclass, field
from typing import final

import numpy as np
from jaxtyping import Float32, Int16, UInt8
from numpy import ndarray

from pix2face.files.images import decode_image
from pix2face.shards.layers import IMAGE
from pix2face.shards.shard_reader import ShardReader

TRAINED_LAYERS = ("pncc", "offset", "mask", "seen")
_N_COUNTS = 8


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class DecodedSample:
    """A picture, and its maps where there is a face. A row of a batch has maps as large as the picture."""

    image: UInt8[ndarray, "h w 3"]  # RGB
    pncc: Int16[ndarray, "y x 3"]  # steps of 1/128 mm, cut to the bounding box of the mask, as the following maps are
    offset: Int16[ndarray, "y x 3"]  # steps of 1/128 mm
    mask: UInt8[ndarray, "y x"]  # 1 where both maps hold, else 0
    seen: UInt8[ndarray, "y x"] | None  # 1 where the picture shows the face; None where the set does not know
    corner: tuple[int, int] = (0, 0)  # top left corner (x, y) of the cut in the picture, px
    landmarks2d: Float32[ndarray, "m 2"] = field(default_factory=lambda: np.zeros((0, 2), np.float32))  # px

    def to_bytes(self) -> bytes:
        """Returns the sample as one block of bytes, which ``from_bytes`` reads."""
        shapes = [*self.image.shape[:2], *self.mask.shape, *self.corner, len(self.landmarks2d)]
        counts = [*shapes, int(self.seen is not None)]
        planes = [self.landmarks2d, self.pncc, self.offset, self.mask, self.image]
        planes += [] if self.seen is None else [self.seen]
        return b"".join([np.array(counts, np.int64).tobytes(), *(plane.tobytes() for plane in planes)])

    @classmethod
    def from_bytes(cls, content: memoryview) -> "DecodedSample":
        """The sample of ``to_bytes``, as views of the bytes: nothing is copied."""
        height, width, y, x, left, top, m, has_seen = np.frombuffer(content, np.int64, _N_COUNTS).tolist()
        used = 8 * _N_COUNTS

        def take(dtype: type, *shape: int) -> ndarray:
            nonlocal used
            taken: ndarray = np.frombuffer(content, dtype, int(np.prod(shape)), offset=used).reshape(shape)
            used += taken.nbytes
            return taken

        return cls(
            landmarks2d=take(np.float32, m, 2),
            pncc=take(np.int16, y, x, 3),
            offset=take(np.int16, y, x, 3),
            mask=take(np.uint8, y, x),
            image=take(np.uint8, height, width, 3),
            seen=take(np.uint8, y, x) if has_seen else None,
            corner=(left, top),
        )


def decode_sample(reader: ShardReader, index: int, *, is_checked: bool) -> DecodedSample:
    """Reads and decodes the sample at a place of a shard, and compares its checksum if ``is_checked``.

    Raises:
        InputFileError: The sample is damaged.
    """
    layers = [name for name in TRAINED_LAYERS if name in reader.header.layers]
    stored = reader.stored(index, (*layers, IMAGE, "box_px", "landmarks2d"), is_checked=is_checked)
    top, left = stored["box_px"][:2].tolist()
    return DecodedSample(
        image=decode_image(stored[IMAGE], f"{reader.path}, sample {index}"),
        pncc=stored["pncc"],
        offset=stored["offset"],
        mask=stored["mask"],
        seen=stored.get("seen"),
        corner=(left, top),
        landmarks2d=stored["landmarks2d"],
    )
