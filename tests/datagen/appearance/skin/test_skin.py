"""What skins are drawn from, and that they are those of people."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datagen.appearance.person import Person, draw_person
from datagen.appearance.skin.make_up import FACE_PAINTS
from datagen.appearance.skin.marks import MAX_MARKS
from datagen.appearance.skin.skin import draw_skin
from datagen.appearance.skin.skin_config import HARD_SKIN, SkinConfig
from datagen.appearance.skin.skin_textures import IRISES, SKINS
from datagen.appearance.skin.tone import albedo_of_skin, density_of_melanin, lab_of_linear
from tests.benchmarks.skin import individual_typology_angle_deg

PERSON = Person(age_years=30.0, femininity=0.0, african=0.2, asian=0.2, caucasian=0.6, melanin=0.3)
# L*a*b* of human skin as spectrophotometers have it, with a margin for flush: a* 2 to 24, b* 4 to 27.
HUMAN_AB = np.array([[2.0, 24.0], [4.0, 27.0]])


def _skins(n: int, config: SkinConfig = SkinConfig(), **person: float):  # noqa: B008 - frozen
    rng = np.random.default_rng(7)
    return [draw_skin(rng, config, replace(draw_person(rng), **person)) for _ in range(n)]


@pytest.mark.parametrize("config", [SkinConfig(), HARD_SKIN])
def test_what_is_drawn_stays_within_what_the_shader_takes(config):
    for skin in _skins(200, config):
        assert 0 <= skin.melanin <= 1
        assert 0 <= skin.flush <= 0.7
        assert set(skin.textures) <= set(SKINS)
        assert len(set(skin.textures)) == 3
        assert sum(skin.texture_weights) == pytest.approx(1, abs=0.002)
        assert len(skin.marks) <= MAX_MARKS
        assert skin.eyes.fibres in IRISES
        assert 0.1 < skin.eyes.pupil < 0.85
        assert skin.make_up.face_paint in FACE_PAINTS
        assert all(0 <= value <= 1.1 for value in skin.wrinkles)


def test_skins_are_as_often_dark_as_light():
    lightness = np.array([lab_of_linear(albedo_of_skin(density_of_melanin(s.melanin), 0.16))[0] for s in _skins(600)])
    shares = np.histogram(lightness, bins=[0, 35, 50, 65, 90])[0] / len(lightness)
    assert (shares > 0.08).all(), shares
    assert np.ptp(np.percentile(lightness, [2, 98])) > 45


def test_age_brings_wrinkles_and_sex_a_beard():
    young, old = (_skins(80, age_years=age) for age in (20.0, 78.0))
    assert np.mean([s.wrinkles for s in old]) > 4 * np.mean([s.wrinkles for s in young])
    women, men = (_skins(80, femininity=value, age_years=40.0) for value in (1.0, 0.0))
    assert max(s.shaved_shadow + s.stubble for s in women) == 0
    assert np.mean([s.shaved_shadow for s in men]) > 0.2
    lipstick = [np.mean([s.make_up.lipstick_strength > 0 for s in skins]) for skins in (women, men)]
    assert lipstick[0] > 4 * lipstick[1]


def test_dark_people_have_brown_eyes_and_light_people_all_colours():
    dark, light = (
        _skins(150, melanin=m, african=float(m > 0.5), asian=0.0, caucasian=float(m < 0.5)) for m in (0.8, 0.1)
    )
    bluish = [np.mean([s.eyes.left_outer[2] > s.eyes.left_outer[0] for s in skins]) for skins in (dark, light)]
    assert bluish[0] < 0.03
    assert 0.1 < bluish[1] < 0.8


@given(melanin=st.floats(0, 1), haemoglobin=st.floats(0.05, 0.5))
def test_skin_has_a_human_colour_whatever_is_in_it(melanin, haemoglobin):
    lab = lab_of_linear(albedo_of_skin(density_of_melanin(melanin), haemoglobin))
    assert (HUMAN_AB[:, 0] <= lab[1:]).all()
    assert (lab[1:] <= HUMAN_AB[:, 1]).all()


def test_melanin_darkens_evenly_over_the_whole_human_range():
    steps = np.linspace(0, 1, 11)
    colours = np.array([albedo_of_skin(density_of_melanin(m), 0.16) for m in steps])
    lightness = lab_of_linear(colours)[:, 0]
    assert (np.diff(lightness) < -4).all()
    assert np.ptp(np.diff(lightness)) < 0.5
    assert colours[0] == pytest.approx([0.75, 0.55, 0.45], abs=0.03)
    assert colours[-1] == pytest.approx([0.06, 0.03, 0.02], abs=0.012)
    angle = individual_typology_angle_deg(colours)
    assert angle[0] > 55
    assert angle[-1] < -55
    assert (np.diff(angle) < 0).all()


def test_blood_reddens_without_darkening_much():
    pale, flushed = (albedo_of_skin(0.1, value) for value in (0.1, 0.4))
    assert flushed[0] > 0.95 * pale[0]
    assert flushed[1] < 0.8 * pale[1]


def test_what_is_rare_is_less_rare_in_the_hard_preset():
    rare = [field.name for field in fields(SkinConfig) if field.name.endswith("_share")]
    assert all(getattr(HARD_SKIN, name) >= getattr(SkinConfig(), name) for name in rare)
