"""Predicted maps come back from every format to within its step."""

import json
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.geometry.crops import FaceBox, square_crop
from pix2face.geometry.maps import FaceMaps
from pix2face.inference.predictor import Prediction
from pix2face.photographs.map_files import MAP_FORMATS, PNG16_STEPS_PER_MM, maps_to_png16, parse_formats

SIZE_PX = 48
BOX = FaceBox(10, 20, 91, 95)


def prediction(largest_mm: float = 250.0, seed: int = 0, score: float | None = 1.25) -> Prediction:
    rng = np.random.default_rng(seed)
    mask = rng.random((SIZE_PX, SIZE_PX)) < 0.4
    planes = rng.uniform(-largest_mm, largest_mm, (2, SIZE_PX, SIZE_PX, 3)).astype(np.float32) * mask[..., None]
    planes[:, 0, 0], mask[0, 0] = 0, True  # 0 mm inside the mask is not the background
    return Prediction(FaceMaps(planes[0], planes[1], mask), square_crop(BOX, 1.4, SIZE_PX), BOX, score)


def test_npz_is_exact(tmp_path: Path) -> None:
    given = prediction()
    MAP_FORMATS["npz"](tmp_path, "face", given)
    with np.load(tmp_path / "face.npz", allow_pickle=False) as file:
        for name in ("pncc", "offset", "mask"):
            np.testing.assert_array_equal(file[name], getattr(given.maps, name))
        np.testing.assert_array_equal(file["image_from_crop"], given.crop.image_from_crop)
        assert (file["box_px"].tolist(), float(file["score"])) == ([10, 20, 91, 95], 1.25)
    MAP_FORMATS["npz"](tmp_path, "given", prediction(score=None))
    with np.load(tmp_path / "given.npz", allow_pickle=False) as file:
        assert np.isnan(file["score"])


def test_16_bit_png_is_within_half_a_step(tmp_path: Path) -> None:
    given = prediction()
    MAP_FORMATS["png16"](tmp_path, "face", given)
    assert {path.name for path in tmp_path.iterdir()} == {
        *(f"face-{name}.png" for name in ("pncc", "offset", "mask")),
        "face-crop.json",
    }
    mask = cv2.imread(str(tmp_path / "face-mask.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(mask, given.maps.mask * 255)
    for name in ("pncc", "offset"):
        coded = cv2.imread(str(tmp_path / f"face-{name}.png"), cv2.IMREAD_UNCHANGED)[..., ::-1]
        assert coded.dtype == np.uint16
        np.testing.assert_array_equal((coded != 0).all(axis=2), given.maps.mask)
        decoded = (coded[given.maps.mask].astype(np.float64) - 32768) / 128
        assert np.abs(decoded - getattr(given.maps, name)[given.maps.mask]).max() <= 0.5 / PNG16_STEPS_PER_MM + 1e-6
    crop = json.loads((tmp_path / "face-crop.json").read_text())
    np.testing.assert_array_equal(crop["image_from_crop"], given.crop.image_from_crop)
    assert crop["size_px"] == SIZE_PX
    assert (crop["box_px"], crop["score"]) == ([10, 20, 91, 95], 1.25)


@pytest.mark.parametrize("value", [300.0, -256.0, np.nan, np.inf])
def test_16_bit_png_refuses_what_it_cannot_hold(value: float) -> None:
    values, mask = np.zeros((3, 3, 3), dtype=np.float32), np.ones((3, 3), dtype=bool)
    values[1, 2, 0] = value
    with pytest.raises(DegenerateGeometryError, match="--format npz or exr"):
        maps_to_png16(values, mask)
    mask[1, 2] = False
    assert maps_to_png16(values, mask)[1, 2].tolist() == [0, 0, 0]


def test_exr_is_exact(tmp_path: Path) -> None:
    given = prediction(1e4)
    MAP_FORMATS["exr"](tmp_path, "caf\udce9", given)
    (path,) = tmp_path.iterdir()
    readable = path.rename(tmp_path / "face.exr")
    file = OpenEXR.File(str(readable), separate_channels=True)
    channels = file.channels()
    names = [f"{layer}.{axis}" for layer in ("pncc", "offset") for axis in "XYZ"]
    assert set(channels) == {*names, "mask"}
    for layer in ("pncc", "offset"):
        found = np.stack([channels[f"{layer}.{axis}"].pixels for axis in "XYZ"], axis=2)
        assert found.dtype == np.float32
        np.testing.assert_array_equal(found, getattr(given.maps, layer))
    np.testing.assert_array_equal(channels["mask"].pixels, given.maps.mask.astype(np.float32))
    np.testing.assert_array_equal(file.header()["image_from_crop"], given.crop.image_from_crop)
    assert file.header()["unit"] == "mm"
    assert file.header()["score"] == 1.25
    np.testing.assert_array_equal(file.header()["box_px"], [[10, 20], [91, 95]])


def test_formats_are_read_from_a_list() -> None:
    assert parse_formats("exr, npz,exr") == ("exr", "npz")
    for text in ("tiff", "", "npz,,"):
        with pytest.raises(UsageError, match="expected --format to list some of npz, png16, exr"):
            parse_formats(text)
