"""HEIC photographs are read with the extra, and named as what they are without it."""

import importlib
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pix2face.errors import InputFileError
from pix2face.files.heif import is_heic
from pix2face.files.images import decode_image, read_photograph, read_size_px, upright_bytes

pillow_heif = pytest.importorskip("pillow_heif", reason="pip install 'pix2face[heic]'")


def heic(orientation: int = 1) -> bytes:
    """A picture of 64 x 48 pixels, red on the left and blue on the right."""
    pixels = np.zeros((48, 64, 3), dtype=np.uint8)
    pixels[:, :32, 0] = pixels[:, 32:, 2] = 200
    picture, tags, file = pillow_heif.from_pillow(Image.fromarray(pixels)), Image.Exif(), BytesIO()
    tags[0x0112] = orientation
    picture[0].info["exif"] = tags.tobytes()  # saved as the rotation of HEIC itself
    picture.save(file, quality=95)
    return file.getvalue()


def test_a_heic_photograph_is_read_upright(tmp_path: Path) -> None:
    for orientation, size in ((1, (48, 64)), (6, (64, 48))):
        path = tmp_path / f"{orientation}.heic"
        path.write_bytes(heic(orientation))
        image = read_photograph(path)
        assert image.shape[:2] == read_size_px(path) == size
        first, last = (image[:4, :4], image[-4:, -4:]) if orientation == 6 else (image[:, :4], image[:, -4:])
        assert first.mean(axis=(0, 1)).argmax() == 0
        assert last.mean(axis=(0, 1)).argmax() == 2


def test_shards_get_it_as_jpeg() -> None:
    content = upright_bytes(heic(), "here")
    assert content.startswith(b"\xff\xd8")
    assert decode_image(content, "here").shape == (48, 64, 3)


def test_without_the_extra_it_is_named_with_the_command_that_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    (tmp_path / "a.jpg").write_bytes(heic())  # phones rename them
    monkeypatch.setattr(importlib, "import_module", missing)
    with pytest.raises(InputFileError, match=r"a\.jpg: .*found HEIC.*pip install 'pix2face\[heic\]'"):
        read_photograph(tmp_path / "a.jpg")


@pytest.mark.parametrize("n_bytes", [60, 300, -40])
def test_damaged_files_are_named(tmp_path: Path, n_bytes: int) -> None:
    (tmp_path / "a.heic").write_bytes(heic()[:n_bytes])
    with pytest.raises(InputFileError, match=r"a\.heic: expected a"):
        read_photograph(tmp_path / "a.heic")


def test_brands() -> None:
    assert is_heic(b"\0\0\0\x18ftypmif1\0\0\0\0mif1heic")
    assert not is_heic(b"\0\0\0\x1cftypavif\0\0\0\0avifmif1miaf")
    assert not is_heic(b"\0\0\0\x14ftypmif1\0\0\0\0avifheic")  # "heic" is no longer of the head's list
    assert not is_heic(b"")
