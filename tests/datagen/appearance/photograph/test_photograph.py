"""Photographs: the same bytes for the same light, each step doing what it says, decent ones most of the time."""

from dataclasses import fields, replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datagen.appearance.photograph.border import FILLINGS, Border
from datagen.appearance.photograph.faults import draw_photograph
from datagen.appearance.photograph.lens import Lens, expose_through
from datagen.appearance.photograph.photograph import Photograph, develop, encode
from datagen.appearance.photograph.photograph_config import FAULTS, HARD_PHOTOGRAPH, PhotographConfig
from datagen.appearance.photograph.sensor import MIDDLE_GREY, Sensor, Tone, noise_window, sense, tone, tone_curve
from pix2face.errors import UsageError

DEFAULT = PhotographConfig()
AS_IT_IS = Sensor(metering_strength=0.0, white_balance=0.0)
HEIGHT, WIDTH = 60, 80


def drawn(n: int, config: PhotographConfig = DEFAULT) -> list[Photograph]:
    return [draw_photograph(np.random.default_rng([7, index]), config) for index in range(n)]


def scene(height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """Smooth shapes of several brightnesses and colours, linear light."""
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    light = np.stack([0.2 + 0.1 * np.sin(rows / 7), 0.15 + 0.1 * np.cos(columns / 9), 0.1 + 0.002 * rows], axis=-1)
    light[20:40, 30:50] = [0.5, 0.35, 0.28]
    return light.astype(np.float32)


def face_of(light: np.ndarray) -> np.ndarray:
    face = np.zeros(light.shape[:2], dtype=bool)
    face[20:40, 30:50] = True
    return face


def linear(image: np.ndarray) -> np.ndarray:
    value = image / 255.0
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def test_a_photograph_alone_decides_the_bytes() -> None:
    light = scene()
    for photograph in drawn(60, HARD_PHOTOGRAPH):
        image = develop(light, photograph, face_of(light))
        assert image.shape == light.shape
        np.testing.assert_array_equal(image, develop(light, photograph, face_of(light)))
        assert encode(image, photograph) == encode(image, photograph)
    np.testing.assert_array_equal(light, scene())  # what was given is not written to


def test_one_picture_in_five_is_bad_and_every_fault_occurs() -> None:
    photographs = drawn(2000)
    assert abs(np.mean([bool(p.faults) for p in photographs]) - 0.2) < 0.02
    assert {fault for p in photographs for fault in p.faults.split("+") if fault} == set(FAULTS)
    assert abs(np.mean([p.border.is_there for p in photographs]) - 0.27) < 0.02
    errors = np.abs([p.sensor.exposure_error_ev for p in photographs if "exposure" not in p.faults])
    assert 0.6 < (errors < 0.4).mean() < 0.9
    qualities = [p.quality for p in photographs]
    assert min(qualities) < 40
    assert max(qualities) > 94
    hard = drawn(500, HARD_PHOTOGRAPH)
    assert np.mean([bool(p.faults) for p in hard]) > 0.5


def test_decent_photographs_show_what_was_there() -> None:
    light = scene(128, 128)
    wanted = linear(tone(Tone(), light)) @ [0.2, 0.7, 0.1]
    correlations = []
    for photograph in drawn(300):
        if not photograph.faults:
            image = linear(develop(light, replace(photograph, border=Border()), face_of(light))) @ [0.2, 0.7, 0.1]
            correlations.append(np.corrcoef(wanted.ravel(), image.ravel())[0, 1])
    assert len(correlations) > 200
    assert np.percentile(correlations, 2) > 0.8


def test_nothing_done_to_light_is_the_srgb_curve() -> None:
    light = np.linspace(0, 1, 300, dtype=np.float32).reshape(10, 10, 3)
    image = tone(Tone(), sense(AS_IT_IS, expose_through(Lens(), light), np.zeros((10, 10), bool), rng()))
    srgb = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055)
    assert np.abs(image - 255 * srgb).max() < 1.0


def test_cameras_expose_for_the_face_where_there_is_one() -> None:
    light = scene()
    light[:, :30] = 6.0  # a window
    face = face_of(light)
    for strength, tolerance in ((1.0, 0.05), (0.0, 10.0)):
        sensor = Sensor(is_metered_on_face=True, metering_strength=strength, white_balance=0.0)
        exposed = sense(sensor, 0.1 * light, face, rng())
        brightness = exposed[face] @ [0.2126, 0.7152, 0.0722]
        assert abs(brightness.mean() - MIDDLE_GREY) < tolerance
    on_all = sense(Sensor(is_metered_on_face=False), light, face, rng())
    on_face = sense(Sensor(is_metered_on_face=True), light, face, rng())
    blind = Sensor(is_metered_on_face=True, white_balance=0.0)
    nowhere = sense(blind, light, np.zeros_like(face), rng())
    assert on_all[face].mean() < 0.5 * on_face[face].mean()
    np.testing.assert_allclose(nowhere, sense(replace(blind, is_metered_on_face=False), light, face, rng()), rtol=1e-5)
    one_stop = sense(Sensor(is_metered_on_face=False, exposure_error_ev=1.0), light, face, rng())
    np.testing.assert_allclose(one_stop, 2 * on_all, rtol=1e-5)


def test_white_balance_takes_the_colour_of_the_light_away() -> None:
    grey = np.repeat(scene()[..., :1], 3, axis=-1)
    light = grey * np.array([1.3, 1.0, 0.7], dtype=np.float32)
    balanced = sense(Sensor(metering_strength=0.0, white_balance=1.0), light, face_of(light), rng())
    np.testing.assert_allclose(balanced, balanced[..., 1:2].repeat(3, axis=-1), rtol=1e-4)


@pytest.mark.parametrize("wall", [(0.05, 0.6, 0.1), (0.7, 0.5, 0.02)])
def test_a_coloured_wall_is_not_taken_for_grey(wall: tuple[float, float, float]) -> None:
    light = np.full((HEIGHT, WIDTH, 3), wall, dtype=np.float32)
    face = face_of(light)
    light[face] = (0.5, 0.3, 0.2)
    light[:10] = 0.3
    balanced = sense(Sensor(metering_strength=0.0, white_balance=1.0), light, face, rng())
    np.testing.assert_allclose(balanced[face].mean(axis=0), (0.5, 0.3, 0.2), rtol=1e-4)


@pytest.mark.parametrize(("balance", "is_bluer"), [(1.0, False), (0.3, False), (0.0, True)])
def test_a_camera_that_balances_leaves_no_skin_bluer_than_green(balance: float, is_bluer: bool) -> None:
    light = np.full((HEIGHT, WIDTH, 3), (0.4, 0.45, 0.3), dtype=np.float32)  # olive: makes the balance bluer
    face = face_of(light)
    light[face] = (0.5, 0.33, 0.4)
    red, green, blue = sense(Sensor(metering_strength=0.0, white_balance=balance), light, face, rng())[face].mean(
        axis=0
    )
    assert (blue > green * 1.001) == is_bluer
    assert red > green


def test_skin_is_not_taken_for_grey() -> None:
    """A face that fills most of the picture keeps its colour, whatever the balance."""
    light = scene()
    face = np.zeros(light.shape[:2], dtype=bool)
    face[4:-4, 4:-4] = True
    light[face] = (0.5, 0.3, 0.2)
    light[~face] = 0.3
    balanced = sense(Sensor(metering_strength=0.0, white_balance=1.0), light, face, rng())
    np.testing.assert_allclose(balanced[face].mean(axis=0), (0.5, 0.3, 0.2), rtol=1e-4)


@given(
    st.floats(0, 1), st.floats(0.5, 2), st.floats(0.7, 1.5), st.floats(0, 0.2), st.floats(0.7, 1.0), st.floats(0, 0.3)
)
def test_tone_curves_never_turn_back(
    roll_off: float, contrast: float, gamma: float, black: float, white: float, lift: float
) -> None:
    curve = tone_curve(Tone(roll_off=roll_off, contrast=contrast, gamma=gamma, black=black, white=white, lift=lift))
    assert (np.diff(curve.astype(int)) >= 0).all()
    assert curve[-1] == 255
    assert abs(int(curve[0]) - 255 * lift) <= 1


def test_film_keeps_middle_grey_and_bends_highlights() -> None:
    light = np.array([[[MIDDLE_GREY] * 3, [0.95] * 3, [2.0] * 3]], dtype=np.float32)
    cut, film = (tone(Tone(roll_off=value), light)[0, :, 0].astype(int) for value in (0.0, 1.0))
    assert abs(film[0] - cut[0]) <= 1
    assert film[1] < cut[1]
    assert film[1] < film[2]


@pytest.mark.parametrize(
    "lens", [Lens(defocus=0.05), Lens(motion=0.1, motion_deg=30, motion_bend=0.5), Lens(bloom=0.3), Lens(glare=0.4)]
)
def test_lenses_spread_light_and_lose_none(lens: Lens) -> None:
    light = np.zeros((101, 101, 3), dtype=np.float32)
    light[50, 50] = 9.0
    spread = expose_through(lens, light)
    assert spread.max() < 0.8 * 9
    np.testing.assert_allclose(spread.sum(axis=(0, 1)), 9, rtol=0.02)
    rows, columns = np.mgrid[:101, :101]
    weight = spread[..., 0] / spread[..., 0].sum()
    assert abs((weight * rows).sum() - 50) < 0.3  # the picture stays where it is, and maps with it
    assert abs((weight * columns).sum() - 50) < 0.3


def test_a_disc_is_as_large_and_a_path_as_long_as_said() -> None:
    light = np.zeros((101, 101, 3), dtype=np.float32)
    light[50, 50] = 1.0
    disc = expose_through(Lens(defocus=0.08), light)[..., 0] > 1e-6
    assert abs(disc.sum() / np.pi - 8.08**2) < 20
    path = expose_through(Lens(motion=0.2, motion_deg=0), light)[..., 0]
    assert 18 <= (path[50] > 1e-6).sum() <= 23
    assert path[50].sum() == pytest.approx(1, abs=1e-3)


def test_corners_are_as_dark_as_said() -> None:
    light = np.ones((100, 100, 3), dtype=np.float32)
    dark = expose_through(Lens(vignetting=0.5), light)
    assert dark[0, 0, 0] == pytest.approx(0.5, abs=0.02)
    assert dark[50, 50, 0] == pytest.approx(1.0, abs=0.01)
    aside = expose_through(Lens(vignetting=0.5, axis=(0.4, 0.4)), light)
    assert aside[0, 0, 0] == pytest.approx(0.5, abs=0.02)
    assert aside[90, 90, 0] == pytest.approx(1.0, abs=0.01)


def test_chromatic_aberration_moves_red_and_blue_apart_but_not_in_the_middle() -> None:
    light = np.zeros((101, 101, 3), dtype=np.float32)
    light[:, ::10] = 1.0
    fringed = expose_through(Lens(magnification=0.02), light)
    assert np.abs(fringed[:, 50] - light[:, 50]).max() < 0.05
    assert np.abs(fringed[:, 90, 0] - fringed[:, 90, 2]).max() < 0.7
    assert fringed[50, 90, 1] == 1
    assert fringed[50, 90, 0] < 0.5


def test_noise_is_as_strong_as_said_and_grows_with_the_light() -> None:
    grey = np.full((200, 200, 3), MIDDLE_GREY, dtype=np.float32)
    sensor = replace(AS_IT_IS, noise=0.05, colour_noise=0.0)
    face = np.zeros((200, 200), bool)
    assert sense(sensor, grey, face, rng()).std() == pytest.approx(0.05, rel=0.03)
    assert sense(sensor, 4 * grey, face, rng()).std() > 1.5 * 0.05
    assert sense(sensor, 0 * grey, face, rng()).std() == pytest.approx(0.05 * np.sqrt(0.3), rel=0.03)
    coloured = sense(replace(sensor, colour_noise=0.8), grey, face, rng())
    assert np.corrcoef(coloured[..., 0].ravel(), coloured[..., 2].ravel())[0, 1] < 0.9


@pytest.mark.parametrize("shape", [(40, 50), (1, 3000), (1200, 4)])
def test_noise_is_normal_at_every_size_and_differs_from_picture_to_picture(shape: tuple[int, int]) -> None:
    windows = [noise_window(np.random.default_rng(seed), *shape) for seed in range(2)]
    for window in windows:
        assert window.shape == shape
        assert abs(float(window.mean())) < 0.1
        assert abs(float(window.std()) - 1) < 0.06
        assert abs(np.corrcoef(window.ravel()[1:], window.ravel()[:-1])[0, 1]) < 0.1
    assert abs(np.corrcoef(windows[0].ravel(), windows[1].ravel())[0, 1]) < 0.1


def test_monochrome_is_grey_and_sepia_is_not() -> None:
    light = scene()
    grey = tone(Tone(saturation=0.0), light).astype(int)
    assert np.ptp(grey, axis=2).max() <= 1
    sepia = tone(Tone(saturation=0.0, tint=(1.0, 0.86, 0.66)), light).astype(int)
    assert (sepia[..., 0] >= sepia[..., 1]).all()
    assert (sepia[..., 1] >= sepia[..., 2]).all()


def test_borders_reach_as_far_as_configured() -> None:
    config = replace(DEFAULT, border_share=1.0, letterbox_share=0.0, largest_border=0.3)
    sides = [(p.border.left, p.border.top, p.border.right, p.border.bottom) for p in drawn(500, config)]
    assert 0.25 < np.max(sides) <= 0.3
    counts = (np.array(sides) > 0).sum(axis=1)
    assert set(counts) == {1, 2, 4}
    assert {p.border.filling for p in drawn(500, config)} == set(FILLINGS)


@pytest.mark.parametrize("quality", [30, 60, 95])
def test_files_are_jpeg_of_the_drawn_quality(quality: int) -> None:
    image = tone(Tone(), scene())
    photograph = replace(drawn(1)[0], quality=quality)
    content = encode(image, photograph)
    assert content[:2] == b"\xff\xd8"
    decoded = cv2.cvtColor(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    assert np.abs(decoded.astype(int) - image).mean() < 6
    assert len(content) < len(encode(image, replace(photograph, quality=quality + 3)))


@pytest.mark.parametrize("shape", [(1, 1), (3, 200), (200, 3), (16, 16)])
def test_pictures_of_every_shape_are_developed(shape: tuple[int, int]) -> None:
    light = np.full((*shape, 3), 0.3, dtype=np.float32)
    for photograph in drawn(60, HARD_PHOTOGRAPH):
        assert develop(light, photograph, np.ones(shape, bool)).shape == (*shape, 3)


@pytest.mark.parametrize("value", [0.0, 1e-6, 1e4])
def test_night_and_glare_are_developed_without_warning(value: float) -> None:
    light = np.full((32, 32, 3), value, dtype=np.float32)
    for photograph in drawn(30, HARD_PHOTOGRAPH):
        develop(light, photograph, np.zeros((32, 32), bool))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"jpeg_quality": (0.0, 90.0)},
            r"jpeg_quality: expected 2 ascending numbers from 1 to 100, found \[0.0, 90.0\]",
        ),
        ({"largest_border": 0.6}, "largest_border: expected a number from 0 to 0.45"),
        (
            {"border_share": 0.8, "letterbox_share": 0.3},
            "border_share: expected at most 1 together with letterbox_share",
        ),
        ({f"bad_{name}": 0.0 for name in FAULTS}, "bad_exposure: expected a number above 0 here or for bad_colour"),
    ],
)
def test_configurations_that_cannot_be_drawn_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        replace(DEFAULT, **changes).check()  # type: ignore[arg-type]


def test_every_number_is_a_float() -> None:
    assert all(isinstance(field.default, float | tuple) for field in fields(PhotographConfig))


def rng() -> np.random.Generator:
    return np.random.default_rng(0)
