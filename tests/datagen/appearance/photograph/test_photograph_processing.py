"""What happens to pictures after the camera: programs, small files, borders."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datagen.appearance.photograph.border import FILLINGS, Border, beyond_border, with_border
from datagen.appearance.photograph.processing import Processing, process

HEIGHT, WIDTH = 60, 80


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def picture() -> np.ndarray:
    """Smooth shapes with one sharp edge."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    image = np.stack([120 + 60 * np.sin(rows / 7), 110 + 60 * np.cos(columns / 9), 90 + rows], axis=-1)
    image[20:40, 30:50] = [200, 160, 140]
    return image.astype(np.uint8)


def test_enlarged_pictures_have_no_more_detail_than_small_ones() -> None:
    image = rng().integers(0, 256, (128, 128, 3), dtype=np.uint8)
    for way in ("nearest", "linear", "cubic"):
        enlarged = process(Processing(side_px=32, enlarged_by=way), image, rng())
        assert enlarged.shape == image.shape
        spectrum = np.abs(np.fft.fft2(enlarged[..., 1] - enlarged[..., 1].mean()))
        assert (spectrum[:16, :16] ** 2).mean() > 5 * (spectrum[40:64, 40:64] ** 2).mean()
    np.testing.assert_array_equal(process(Processing(side_px=128), image, rng()), image)


def test_processing_nothing_changes_nothing() -> None:
    image = picture()
    np.testing.assert_array_equal(process(Processing(), image, rng()), image)


@pytest.mark.parametrize(
    "processing",
    [
        Processing(smoothing=1.0),
        Processing(sharpening=1.0),
        Processing(grain=8.0),
        Processing(scratches=3),
        Processing(dust=20),
        Processing(interlace=0.012),
        Processing(moire=0.1),
        Processing(colours=5),
        Processing(text="12.03.2004", text_place=(0.1, 0.9), text_size=0.1, text_opacity=0.9),
        Processing(first_quality=40),
    ],
)
def test_every_kind_of_processing_shows_but_leaves_the_picture(processing: Processing) -> None:
    image = picture()
    changed = process(processing, image, rng())
    assert (changed != image).any()
    assert changed.shape == image.shape
    assert np.corrcoef(image.ravel(), changed.ravel())[0, 1] > 0.6
    np.testing.assert_array_equal(image, picture())


@pytest.mark.parametrize("share", [0.004, -0.012, 0.02])
def test_lines_of_two_moments_leave_edges_where_they_are_on_average(share: float) -> None:
    image = np.zeros((40, 200, 3), dtype=np.uint8)
    image[:, 80:] = 255
    found = process(Processing(interlace=share), image, rng())
    edge = 200 - (found[..., 0] > 127).sum(axis=1)
    assert edge.mean() == pytest.approx(80)
    assert abs(edge[1] - edge[0]) == max(2, 2 * round(abs(share) * 100))
    assert edge[1] > edge[0] if share > 0 else edge[1] < edge[0]


borders = st.builds(
    Border,
    left=st.floats(0, 0.4),
    top=st.floats(0, 0.4),
    right=st.floats(0, 0.4),
    bottom=st.floats(0, 0.4),
    filling=st.sampled_from(FILLINGS),
)


@given(borders, st.integers(1, 40), st.integers(1, 40))
def test_inside_the_border_nothing_changes_and_the_mask_says_where_that_is(
    border: Border, height: int, width: int
) -> None:
    image = rng().integers(0, 256, (height, width, 3), dtype=np.uint8)
    framed = with_border(border, image)
    beyond = beyond_border(border, height, width)
    assert framed.shape == image.shape
    np.testing.assert_array_equal(framed[~beyond], image[~beyond])
    assert abs((~beyond).any(axis=0).sum() - max((1 - border.left - border.right) * width, 1)) <= 1.01
    assert abs((~beyond).any(axis=1).sum() - max((1 - border.top - border.bottom) * height, 1)) <= 1.01
    if border.filling in ("black", "white") and beyond.any():
        assert (framed[beyond] == (255 if border.filling == "white" else 0)).all()


def test_fillings_are_what_their_names_say() -> None:
    image = picture()
    beyond = beyond_border(Border(left=0.25), HEIGHT, WIDTH)
    assert beyond[:, :20].all()
    assert not beyond[:, 20:].any()
    framed = {name: with_border(Border(left=0.25, filling=name), image) for name in FILLINGS}
    assert (framed["replicated"][:, :20] == image[:, 20:21]).all()
    assert (framed["reflected"][:, :20] == image[:, 20:40][:, ::-1]).all()
    np.testing.assert_allclose(framed["mean"][0, 0], image[:, 20:].mean(axis=(0, 1)), atol=1)
    rough = rng().integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    assert with_border(Border(left=0.25, filling="blurred"), rough)[:, :20].std() < 0.5 * rough.std()
