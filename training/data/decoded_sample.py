"""A sample in memory, and as the bytes of a cache that several processes share."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float32, Int16, UInt8
from numpy import ndarray

from pix2face.files.images import decode_image
from pix2face.shards.sample_spans import StoredSample

# Of what is wanted of a sample, in the order of the cache.
TRAINED_LAYERS = ("pncc", "offset", "mask", "seen")
_N_COUNTS = 8


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class DecodedSample:
    """A picture, and the maps where there is a face.

    Attributes:
        image: RGB.
        pncc: Steps, cut to the mask's bounding box; so are the next three.
        offset: Steps.
        mask: 1 where both hold, else 0.
        seen: 1 where the picture shows it; None where the set does not know.
        corner: Top left corner (x, y) of the cut in the picture, px.
        landmarks2d: px.
    """

    image: UInt8[ndarray, "h w 3"]
    pncc: Int16[ndarray, "y x 3"]
    offset: Int16[ndarray, "y x 3"]
    mask: UInt8[ndarray, "y x"]
    seen: UInt8[ndarray, "y x"] | None
    corner: tuple[int, int]
    landmarks2d: Float32[ndarray, "m 2"]

    def to_bytes(self) -> bytes:
        """As one piece, for ``from_bytes``."""
        counts = [
            *self.image.shape[:2],
            *self.mask.shape,
            *self.corner,
            len(self.landmarks2d),
            int(self.seen is not None),
        ]
        planes = [self.landmarks2d, self.pncc, self.offset, self.mask, self.image]
        planes += [] if self.seen is None else [self.seen]
        return b"".join([np.array(counts, np.int64).tobytes(), *(plane.tobytes() for plane in planes)])

    @classmethod
    def from_bytes(cls, content: memoryview) -> "DecodedSample":
        """What ``to_bytes`` gave; looks at the bytes, copies nothing."""
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


def decode_sample(stored: StoredSample, where: str) -> DecodedSample:
    """Decodes a sample as it was read.

    Args:
        stored: With a picture, PNCC, offset and mask.
        where: Named in errors.

    Raises:
        InputFileError: The picture cannot be decoded.
    """
    return DecodedSample(
        image=decode_image(stored.image, where),
        pncc=stored.steps["pncc"],
        offset=stored.steps["offset"],
        mask=stored.steps["mask"],
        seen=stored.steps.get("seen"),
        corner=stored.corner,
        landmarks2d=stored.landmarks2d,
    )
