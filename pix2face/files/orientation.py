"""The orientation tag of picture files: how viewers turn the stored pixels."""

from contextlib import suppress
from io import BufferedReader, BytesIO
from typing import Any

from PIL.Image import Exif

from pix2face.files.picture_size import HEADS, JPEG_START, TIFF_STARTS, tiff_tags

ORIENTATION = 274
# 1 is upright; 5 to 8 exchange width and height.
UPRIGHT, ON_ITS_SIDE = 1, (5, 6, 7, 8)


def orientation_tag(content: bytes | BufferedReader) -> int:
    """The tag of a picture file, 1 to 8; 1 (upright) where it has none that can be read."""
    if isinstance(content, bytes) and content.startswith(JPEG_START) and b"Exif" not in content:
        return UPRIGHT  # Pillow would take ten times as long
    file = BytesIO(content) if isinstance(content, bytes) else content
    file.seek(0)
    start = file.read(4)
    file.seek(0)
    found: Any = None
    with suppress(Exception):  # Pillow raises many kinds of errors for damaged tags; such tags count as none
        if start in TIFF_STARTS:
            found = tiff_tags(file).get(ORIENTATION)
        else:
            head = next(head for magic, head in HEADS.items() if start.startswith(magic))
            exif = Exif()  # not `getexif`, which decodes a PNG
            exif.load(head.open(file).info.get("exif", b""))
            found = exif.get(ORIENTATION)
    return int(found) if found in range(UPRIGHT, 9) else UPRIGHT
