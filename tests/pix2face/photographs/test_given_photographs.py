"""Photographs and boxes as callers have them become one kind of each, or are refused by what was expected."""

from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray
from PIL import Image

from pix2face.errors import DegenerateGeometryError, InputFileError, UsageError
from pix2face.files.picture_head import UPRIGHT
from pix2face.geometry.crops import FaceBox
from pix2face.photographs.given_photographs import as_boxes, as_photograph, as_photographs

ORIENTATION_TAG, TURNED = 0x0112, 6


def half_red(width: int = 40, height: int = 20) -> Image.Image:
    """Red on the left, blue on the right."""
    picture = np.zeros((height, width, 3), dtype=np.uint8)
    picture[:, : width // 2], picture[:, width // 2 :] = (200, 0, 0), (0, 0, 200)
    return Image.fromarray(picture)


@pytest.mark.parametrize("tag", [UPRIGHT, TURNED])
def test_a_path_and_a_pil_image_are_the_same_upright_photograph(tmp_path: Path, tag: int) -> None:
    exif = Image.Exif()
    exif[ORIENTATION_TAG] = tag
    path = tmp_path / "photo.jpg"
    half_red().save(path, exif=exif, quality=95, subsampling=0)
    with Image.open(path) as opened:
        found = [as_photograph(given) for given in (path, str(path), opened)]
    expected = np.asarray(half_red()) if tag == UPRIGHT else np.rot90(np.asarray(half_red()), -1)
    for image in found:
        assert image.dtype == np.uint8
        np.testing.assert_allclose(image.astype(int), expected.astype(int), atol=6)


@pytest.mark.parametrize("mode", ["RGBA", "P", "CMYK", "L", "1", "LA"])
def test_every_8_bit_mode_of_pil_becomes_rgb(mode: str) -> None:
    image = as_photograph(half_red().convert(mode))
    np.testing.assert_array_equal(image, np.asarray(half_red().convert(mode).convert("RGB")))


def test_an_array_is_itself() -> None:
    image = np.asarray(half_red())
    assert as_photograph(image) is image


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((20, 30), dtype=np.uint8),
        np.zeros((20, 30, 4), dtype=np.uint8),
        np.zeros((20, 30, 3), dtype=np.float32),
        np.zeros((0, 30, 3), dtype=np.uint8),
        Image.new("I;16", (30, 20)),
        Image.new("F", (30, 20)),
        b"photo.png",
        None,
        [[[0, 0, 0]]],
        17,
    ],
)
def test_pictures_of_another_kind_are_named(image: object) -> None:
    # Types are checked only under the tests: what a user meets is the check inside.
    with pytest.raises(
        UsageError, match=r"a path, a PIL image, or an array of shape .height, width, 3., RGB, uint8; found"
    ):
        as_photograph(image)


def test_files_that_are_missing_or_cut_off_are_named(tmp_path: Path) -> None:
    for given in (tmp_path / "mistyped.png", str(tmp_path / "mistyped.png")):
        with pytest.raises(InputFileError, match=r"mistyped.png: .*found no such file"):
            as_photograph(given)
    half_red(400, 300).save(tmp_path / "whole.png")
    content = (tmp_path / "whole.png").read_bytes()
    (tmp_path / "half.png").write_bytes(content[: len(content) // 2])
    with Image.open(tmp_path / "half.png") as opened, pytest.raises(InputFileError, match="expected a PIL image"):
        as_photograph(opened)


@pytest.mark.parametrize("images", ["photo.png", Path("photo.png"), half_red(), None])
def test_one_photograph_is_no_list_of_them(images: object) -> None:
    with pytest.raises(UsageError, match="expected several photographs, such as a list, found one of type"):
        as_photographs(images)


@pytest.mark.parametrize(
    "box", [FaceBox(1, 2, 30, 40), (1, 2, 30, 40), [1.0, 2.0, 30.0, 40.0], np.array([1, 2, 30, 40])]
)
def test_four_numbers_are_a_box(box: FaceBox | tuple[float, ...] | list[float] | ndarray) -> None:
    assert as_boxes([box, box]) == [FaceBox(1, 2, 30, 40)] * 2
    assert as_boxes(np.array([[1, 2, 30, 40]])) == [FaceBox(1, 2, 30, 40)]


@pytest.mark.parametrize(
    "boxes", [FaceBox(1, 2, 30, 40), (1, 2, 30, 40), [(1, 2, 30)], ["left"], [None], "1 2 30 40", [{"left": 1}], 5]
)
def test_other_boxes_are_named(boxes: object) -> None:
    with pytest.raises(UsageError, match=r"expected face boxes \[\(left, top, right, bottom\), ...\], found"):
        as_boxes(boxes)


@pytest.mark.parametrize("box", [(9, 9, 9, 9), (30, 10, 10, 40), (0, 0, float("nan"), 10), (0, 0, float("inf"), 9)])
def test_boxes_without_extent_are_named(box: tuple[float, ...]) -> None:
    with pytest.raises(DegenerateGeometryError, match=r"expected a face box .* of at least 1 pixel"):
        as_boxes([box])
