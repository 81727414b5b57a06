"""Pictures of all formats whose heads lie."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from cv2 import IMWRITE_JPEG_PROGRESSIVE, imencode

from tests.fuzz.values import Rng, one


def picture(path: Path, rng: Rng) -> None:
    width, height = (int(one(rng, (0, 1, 7, 300, 32_000, 65_535))) for _ in range(2))
    body = one(rng, (b"", rng.bytes(50), rng.bytes(3000), bytes(10**5)))

    def chunk(name: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    def tiff() -> bytes:
        tags = {
            256: width,
            257: height,
            258: one(rng, (1, 8, 16, 32, 64)),
            259: one(rng, (1, 5, 7, 8)),
            262: one(rng, (0, 1, 2, 3)),
            273: 400,
            277: one(rng, (1, 3, 4, 255)),
            278: height,
            279: len(body),
            339: one(rng, (1, 2, 3, 6)),
        }
        if rng.random() < 0.3:
            tags |= {322: one(rng, (16, 65_535)), 323: one(rng, (16, 65_535)), 324: 400, 325: len(body)}
        entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in sorted(tags.items()))
        return (b"II*\0" + struct.pack("<IH", 8, len(tags)) + entries + bytes(4)).ljust(400, b"\0") + body

    def jpeg() -> bytes:
        image = np.full((int(one(rng, (8, 64))), 64, 3), 90, np.uint8)

        content = imencode(".jpg", image, [IMWRITE_JPEG_PROGRESSIVE, int(rng.integers(2))])[1].tobytes()
        frame = max(content.find(b"\xff\xc0"), content.find(b"\xff\xc2"))
        if rng.random() < 0.6:
            content = content[: frame + 5] + struct.pack(">HH", height, width) + content[frame + 9 :]
        last = content[content.rindex(b"\xff\xda") : -2]
        return content[:-2] + last * int(one(rng, (0, 0, 1, 2000))) + b"\xff\xd9"

    depth, colour = one(rng, (1, 8, 8, 16)), one(rng, (0, 2, 2, 6))
    png = b"\x89PNG\r\n\x1a\n" + chunk(
        b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, one(rng, (0, 1)))
    )
    formats: tuple[Callable[[], bytes], ...] = (
        lambda: png + chunk(b"IDAT", zlib.compress(body)) + chunk(b"IEND", b""),
        lambda: (
            b"GIF89a"
            + struct.pack("<HH", width, height)
            + b"\x80\0\0"
            + bytes(6)
            + b","
            + struct.pack("<HHHH", 0, 0, width, height)
            + b"\0\2\2L\1\0;"
        ),
        lambda: (
            b"BM"
            + struct.pack(
                "<IIIIiiHHIIIIII", 54, 0, 54, 40, width, height * int(one(rng, (1, -1))), 1, 24, 0, 0, 0, 0, 0, 0
            )
            + body
        ),
        lambda: (
            one(rng, (b"P1", b"P4", b"P5", b"P6", b"Pf", b"PF", b"P7")) + f"\n{width} {height}\n255\n".encode() + body
        ),
        lambda: (
            b"\0\0\0\x1cftypavif\0\0\0\0avifmif1" + b"\0\0\0\x14ispe\0\0\0\0" + struct.pack(">II", width, height) + body
        ),
        tiff,
        jpeg,
    )
    path.write_bytes(one(rng, formats)())
