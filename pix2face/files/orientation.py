"""The orientation tag of picture files: how viewers turn the stored pixels."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from io import BufferedReader, BytesIO
from typing import Any

from PIL import JpegImagePlugin, PngImagePlugin, TiffImagePlugin, WebPImagePlugin
from PIL.Image import Exif
from PIL.ImageFile import ImageFile

ORIENTATION = 274
# 1 is upright; 5 to 8 exchange width and height.
UPRIGHT, ON_ITS_SIDE = 1, (5, 6, 7, 8)
JPEG_START = b"\xff\xd8"
# Opened by format, since `PIL.Image.open` has a limit of its own that belongs to the whole process.
_HEADS: Mapping[bytes, Callable[[BytesIO | BufferedReader], ImageFile]] = {
    JPEG_START: JpegImagePlugin.JpegImageFile,
    b"\x89PNG": PngImagePlugin.PngImageFile,
    b"RIFF": WebPImagePlugin.WebPImageFile,
}
_TIFF_STARTS = (b"II*\0", b"MM\0*")


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
        if start in _TIFF_STARTS:
            tags = TiffImagePlugin.ImageFileDirectory_v2(file.read(8))
            file.seek(tags.next)
            tags.load(file)
            found = tags.get(ORIENTATION)
        else:
            head = next(head for magic, head in _HEADS.items() if start.startswith(magic))
            exif = Exif()  # not `getexif`, which decodes a PNG
            exif.load(head(file).info.get("exif", b""))
            found = exif.get(ORIENTATION)
    return int(found) if found in range(UPRIGHT, 9) else UPRIGHT
