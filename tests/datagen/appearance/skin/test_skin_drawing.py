"""What the shader paints on heads."""

from collections.abc import Iterator
from dataclasses import replace

import cv2
import numpy as np
import pytest

from datagen.appearance.person import Person, draw_person
from datagen.appearance.skin.marks import Mark
from datagen.appearance.skin.skin import draw_skin
from datagen.appearance.skin.skin_config import HARD_SKIN, SkinConfig
from datagen.appearance.skin.tone import albedo_of_skin, density_of_melanin, lab_of_linear
from datagen.opengl.gl_context import GLContext
from pix2face.models.morphable_model import builtin_model
from tests.datagen.appearance.skin.painted_skin import RELIEF, PaintedSkin, painted_skin

PLAIN = SkinConfig(make_up_share=0.0, face_paint_share=0.0, vitiligo_share=0.0, moles=0.0, acne_share=0.0)
PERSON = Person(age_years=30.0, femininity=1.0, african=0.0, asian=0.0, caucasian=1.0, melanin=0.25)
SKIN = draw_skin(np.random.default_rng(3), PLAIN, PERSON)
SCALE = 128 / 110


@pytest.fixture(scope="module")
def paint(gl_session: GLContext) -> Iterator[PaintedSkin]:
    with painted_skin(builtin_model(), gl_session) as found:
        yield found


def _zone(picture, x: float, y: float, radius_mm: float = 5.0):
    """Mean around a place of the front (mm)."""
    column, row, reach = (int(v) for v in (128 + SCALE * x, 128 - SCALE * (y - 10), max(SCALE * radius_mm, 1)))
    return picture[row - reach : row + reach + 1, column - reach : column + reach + 1].reshape(-1, 3).mean(axis=0)


def test_the_tone_is_that_of_melanin_and_blood(paint: PaintedSkin):
    for melanin in (0.05, 0.4, 0.9):
        picture, _ = paint.draw(replace(SKIN, melanin=melanin))
        zones = np.array([_zone(picture, *place) for place in ((-42, -25), (42, -25), (0, 78), (25, 75))]).mean(axis=0)
        expected = albedo_of_skin(density_of_melanin(melanin), SKIN.haemoglobin)
        assert zones == pytest.approx(expected, rel=0.25)


def test_luminance_falls_with_melanin_everywhere_on_the_skin(paint: PaintedSkin):
    pictures = [paint.draw(replace(SKIN, melanin=melanin))[0] for melanin in np.linspace(0, 1, 6)]
    for place in ((-42, -20), (0, 78), (0, -5), (0, -72), (0, -50)):
        luminance = [_zone(picture, *place, radius_mm=3) @ [0.2126, 0.7152, 0.0722] for picture in pictures]
        assert (np.diff(luminance) < 0).all(), place


@pytest.mark.parametrize(
    "config", [replace(SkinConfig(), face_paint_share=0.0), replace(HARD_SKIN, face_paint_share=0.0)]
)
def test_no_skin_is_blue_green_or_grey(paint: PaintedSkin, config: SkinConfig):
    rng = np.random.default_rng(11)
    for _ in range(12):
        person = draw_person(rng)
        skin = draw_skin(rng, replace(config, make_up_share=0.0), person)
        picture, _ = paint.draw(skin)
        for place in ((-42, -12), (42, -12), (0, 70), (0, -8), (25, 65)):
            lab = lab_of_linear(_zone(picture, *place))
            assert 1 < lab[1] < 30, (place, skin)
            assert 3 < lab[2] < 30, (place, skin)


def test_lips_are_redder_than_the_skin_around_and_follow_the_lipstick(paint: PaintedSkin):
    picture, _ = paint.draw(SKIN)
    lips, chin = (lab_of_linear(_zone(picture, 0, y, 2)) for y in (-49, -72))
    assert lips[1] > chin[1] + 4
    green = replace(SKIN.make_up, lipstick=(0.02, 0.5, 0.05), lipstick_strength=0.9)
    painted, _ = paint.draw(replace(SKIN, make_up=green))
    assert lab_of_linear(_zone(painted, 0, -49, 2))[1] < -20
    assert _zone(painted, 0, -72, 2) == pytest.approx(_zone(picture, 0, -72, 2), rel=0.01)


def test_nothing_of_an_eye_is_seen_between_closed_lids(paint: PaintedSkin):
    shut = {f"eyeBlink{side}": 1.0 for side in ("Left", "Right")}
    marked = {"skin_sclera": (0.0, 0.9, 0.0, 0.0), "skin_eye_inner": np.full((2, 3), [0, 0.9, 0.0])}
    marked["skin_eye_outer"] = marked["skin_eye_inner"]
    shares = []
    for expression in ({}, shut):
        picture, _ = paint.draw(SKIN, expression, window_mm=(0.0, 27.0, 50.0), changed=marked)
        shares.append((picture[..., 1] > 1.5 * picture[..., 0]).mean())
    assert shares[0] > 0.01
    assert shares[1] < 0.02 * shares[0]


def test_irises_move_with_the_gaze(paint: PaintedSkin):
    marked = {"skin_eye_inner": np.full((2, 3), [0.0, 0.9, 0.0]), "skin_eye_outer": np.full((2, 3), [0.0, 0.9, 0.0])}

    def middle(*looks: str) -> np.ndarray:
        """Row and column of what is green."""
        expression = {f"eyeLook{look}": 0.7 for look in looks}
        picture, _ = paint.draw(SKIN, expression, window_mm=(0.0, 27.0, 50.0), changed=marked)
        return np.mean(np.nonzero(picture[..., 1] > 2.5 * picture[..., 0]), axis=1)

    straight = middle()
    assert middle("OutLeft", "InRight")[1] - straight[1] > 4
    assert straight[1] - middle("InLeft", "OutRight")[1] > 4
    assert straight[1] == pytest.approx(128, abs=2)
    assert straight[0] - middle("UpLeft", "UpRight")[0] > 2
    assert middle("DownLeft", "DownRight")[0] - straight[0] > 2


def test_age_and_expressions_fold_the_skin(gl_session: GLContext):
    smooth = replace(SKIN, wrinkles=(0.0,) * 5, pores=0.0, marks=(), expression_folds=1.0)
    with painted_skin(builtin_model(), gl_session, RELIEF) as paint:
        relief = paint.draw(smooth)[0][..., 0]
        old = paint.draw(replace(smooth, wrinkles=(0.9,) * 5))[0][..., 0]
        raised = paint.draw(smooth, {"browInnerUp": 1.0, "browOuterUpLeft": 1.0, "browOuterUpRight": 1.0})[0][..., 0]
        half = paint.draw(smooth, {"mouthSmileLeft": 1.0})[0][..., 0]
    sides = [half[140:175, columns].mean() for columns in (slice(85, 122), slice(134, 171))]
    assert sides[1] > 3 * sides[0]  # the subject's left is the picture's right
    forehead = (slice(25, 70), slice(85, 170))
    cheek = (slice(140, 190), slice(60, 110))
    assert relief[forehead].mean() < 0.01
    assert old[forehead].mean() > 0.05
    assert old[cheek].mean() > relief[cheek].mean() + 0.003
    assert raised[forehead].mean() > 0.03
    assert abs(raised[cheek].mean() - relief[cheek].mean()) < 0.01


def test_a_bald_head_is_skin_and_a_cropped_one_hair(paint: PaintedSkin):
    black = {"skin_hair_colour": (0.01, 0.01, 0.01), "skin_hairline": 0.0}
    crown, brow = (128, 18), (128, 70)
    bald, cropped = (paint.draw(SKIN, changed={**black, "skin_scalp_hair": value})[0] for value in (0.0, 1.0))
    assert bald[crown[1] - 10, crown[0]].mean() > 0.2
    assert cropped[crown[1] - 10, crown[0]].mean() < 0.05
    assert cropped[brow[1], brow[0]] == pytest.approx(bald[brow[1], brow[0]], rel=0.05)


def test_the_inside_of_an_open_mouth_is_dark(paint: PaintedSkin):
    picture, _ = paint.draw(SKIN, {"jawOpen": 0.9}, window_mm=(0.0, -50.0, 50.0))
    inside = picture[100:150, 110:146].mean(axis=2)
    assert np.percentile(inside, 20) < 0.07
    assert picture[20:60, 40:80].mean() > 0.2


def test_nothing_is_black_white_or_unknown(paint: PaintedSkin):
    rng = np.random.default_rng(19)
    for yaw_deg in (-90.0, -45.0, 0.0, 60.0):
        picture, coverage = paint.draw(draw_skin(rng, HARD_SKIN, draw_person(rng)), {"jawOpen": 0.5}, yaw_deg)
        head = picture[coverage > 0.99]
        assert np.isfinite(head).all()
        assert head.min() >= 0.002
        assert head.max() <= 0.96


def _changed(before, after, x: float, y: float, radius_mm: float = 3.0) -> float:
    """By what share the colour of a place changes."""
    return float(np.abs(_zone(after, x, y, radius_mm) / _zone(before, x, y, radius_mm) - 1).max())


@pytest.mark.parametrize(
    ("worn", "painted", "free"),
    [
        ({"eye_shadow_strength": 0.9, "eye_shadow": (0.02, 0.02, 0.5)}, [(-31, 36), (31, 36)], [(0, -49), (42, -25)]),
        ({"blusher_strength": 0.9, "blusher": (0.6, 0.02, 0.05)}, [(-44, -8), (44, -8)], [(0, 78), (0, -72), (0, -49)]),
        ({"eyeliner": 1.0}, [], [(0, 78), (42, -25), (0, -49), (0, -72)]),
    ],
)
def test_make_up_is_where_people_put_it(paint: PaintedSkin, worn, painted, free):
    bare = replace(SKIN, make_up=replace(SKIN.make_up, eyeliner=0.0))
    before, _ = paint.draw(bare)
    after, _ = paint.draw(replace(bare, make_up=replace(bare.make_up, **worn)))
    assert np.abs(after - before).max() > 0.02
    for place in painted:
        assert _changed(before, after, *place) > 0.08, place
    for place in free:
        assert _changed(before, after, *place) < 0.01, place
    if "eyeliner" in worn:  # at the edges of the lids and nowhere else
        rows, columns = np.nonzero(np.abs(after - before).max(axis=2) > 0.02)
        x, y = (columns - 128) / SCALE, (128 - rows) / SCALE + 10
        assert (np.hypot((np.abs(x) - 31) / 22, (y - 27) / 14) < 1).mean() > 0.98


def test_a_mole_is_dark_and_where_it_is_said_to_be(paint: PaintedSkin):
    spot = Mark(
        kind="mole", place=(-30.0, -20.0, 88.0), radius_mm=4.0, melanin=0.9, haemoglobin=0.1, height=0.5, core=0.6
    )
    before, after = (paint.draw(replace(SKIN, marks=marks))[0] for marks in ((), (spot,)))
    assert _zone(after, -30, -20, 1.5).mean() < 0.6 * _zone(before, -30, -20, 1.5).mean()
    rows, columns = np.nonzero(np.abs(after - before).max(axis=2) > 0.01)
    x, y = (columns - 128) / SCALE, (128 - rows) / SCALE + 10
    assert np.hypot(x + 30, y + 20).max() < 8


def test_freckles_are_small_dark_spots_where_the_sun_comes(paint: PaintedSkin):
    before, after = (paint.draw(replace(SKIN, freckles=freckles))[0] for freckles in ((0.0, 0.0), (0.6, 0.4)))
    darker = 1 - after.mean(axis=2) / np.maximum(before.mean(axis=2), 1e-3)
    cheeks = np.concatenate([darker[128:160, 75:110], darker[128:160, 146:181]])
    neck = darker[240:256, 108:148]
    assert 0.02 < (cheeks > 0.1).mean() < 0.3
    assert cheeks.max() > 0.3
    assert neck.mean() < 0.6 * cheeks.mean()
    assert darker.min() > -0.02
    spots, _ = cv2.connectedComponents((cheeks > 0.1).astype(np.uint8))
    assert spots > 20


def test_a_tongue_that_is_put_out_is_red_and_below_the_lips(paint: PaintedSkin):
    shut, out = (
        paint.draw(SKIN, expression)[0] for expression in ({"jawOpen": 0.5}, {"jawOpen": 0.5, "tongueOut": 1.0})
    )
    rows, columns = np.nonzero(np.abs(out - shut).max(axis=2) > 0.05)
    assert len(rows) > 40
    assert np.abs((columns - 128) / SCALE).mean() < 15
    lab = lab_of_linear(out[rows, columns].mean(axis=0))
    assert lab[1] > 10
