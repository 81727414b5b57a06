"""Expressions: what faces do together, within what they and the mesh bear."""

import json
from collections import Counter
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datagen.random_streams import generator_for
from datagen.rendering.renderer import Renderer
from datagen.sampling.expression_limits import SIDES, limited
from datagen.sampling.expression_recipes import EMOTIONS, EXTREMES, MAYBE, SPEECH
from datagen.sampling.expressions import (
    NAMED_EXPRESSIONS,
    DrawnExpression,
    draw_named_expression,
    expression_of,
    knows_recipes,
    mirrored_strengths,
    strengths_of,
)
from datagen.sampling.faces import sample_faces
from datagen.sampling.sampling_config import DEFAULT_GEOMETRY, HARD_GEOMETRY, GeometryConfig
from datagen.sampling.teeth import ToothGuard
from pix2face.geometry.camera import Camera, HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.models.morphable_model import builtin_model
from tests.synthetic_models import small_head_model

pytestmark = pytest.mark.xdist_group("expressions")  # they are drawn once

NAMES = tuple(builtin_model().named_expressions)


@cache
def one_drawn(index: int, config: GeometryConfig) -> DrawnExpression:
    return draw_named_expression(generator_for(3, str(index)), config, NAMES)


def drawn(n: int, config: GeometryConfig = DEFAULT_GEOMETRY) -> list[DrawnExpression]:
    """The first of those that several tests look at."""
    return [one_drawn(index, config) for index in range(n)]


def test_recipes_speak_of_the_models_own_expressions() -> None:
    recipes = [recipe for table in (EMOTIONS, MAYBE, SPEECH, EXTREMES) for recipe in table.values()]
    for name in {name for recipe in recipes for name in recipe}:
        assert name in NAMES or {name + side for side in SIDES} <= set(NAMES), name
    assert MAYBE.keys() == EMOTIONS.keys()
    assert all(0 < value <= 1 for recipe in recipes for value in recipe.values())


def test_models_whose_shapes_have_other_names_get_random_mixtures_of_them() -> None:
    assert knows_recipes(NAMES)
    assert not knows_recipes(())
    model = small_head_model()
    assert model.named_expressions
    assert not knows_recipes(tuple(model.named_expressions))
    table = sample_faces(model, 20, 0, 128, DEFAULT_GEOMETRY)
    assert table.expression.any(axis=1).mean() > 0.5
    assert NAMED_EXPRESSIONS not in json.loads(table.attributes[0])


def test_kinds_have_their_shares() -> None:
    kinds = Counter(expression.kind.partition("/")[0] for expression in drawn(1500))
    expected = {"neutral": 0.15, "emotion": 0.45, "speech": 0.20, "extreme": 0.06, "mixture": 0.14}
    assert kinds.keys() == expected.keys()
    for kind, share in expected.items():
        assert abs(kinds[kind] / 1500 - share) < 0.04


def test_every_recipe_and_every_expression_occurs() -> None:
    expressions = drawn(2500)
    kinds = {expression.kind for expression in expressions}
    assert {f"emotion/{name}" for name in EMOTIONS} | {f"extreme/{name}" for name in EXTREMES} <= kinds
    assert {name for expression in expressions for name in expression.strengths} == set(NAMES)


@pytest.mark.parametrize("config", [DEFAULT_GEOMETRY, HARD_GEOMETRY])
def test_strengths_are_within_the_limits(config: GeometryConfig) -> None:
    for expression in drawn(600, config):
        strengths = expression.strengths
        assert all(0 < value <= 1 for value in strengths.values())
        for name, value in limited(strengths).items():
            assert value == pytest.approx(strengths[name], abs=0.02)  # rounding aside, nothing is left to limit


def test_left_and_right_are_mostly_alike_but_not_the_same() -> None:
    pairs = [
        (strengths[name], strengths.get(name.removesuffix("Left") + "Right", 0.0))
        for strengths in (expression.strengths for expression in drawn(1200))
        for name in ("mouthSmileLeft", "cheekSquintLeft", "browDownLeft")
        if strengths.get(name, 0) > 0.2
    ]
    left, right = np.array(pairs).T
    assert len(left) > 200
    assert np.corrcoef(left, right)[0, 1] > 0.5
    assert 0.5 < (np.abs(left - right) < 0.2 * np.maximum(left, right)).mean() < 0.97


def test_both_eyes_look_the_same_way() -> None:
    for expression in drawn(1000):
        s = expression.strengths
        for one, other in (("OutLeft", "InRight"), ("InLeft", "OutRight"), ("UpLeft", "UpRight")):
            a, b = (s.get(f"eyeLook{way}", 0.0) for way in (one, other))
            shut = max(s.get("eyeBlinkLeft", 0.0), s.get("eyeBlinkRight", 0.0))
            assert abs(a - b) < 0.02 or shut > 0.2  # behind a lid an eye moves less


def test_lids_follow_a_look_downward() -> None:
    config = replace(DEFAULT_GEOMETRY, neutral_share=1.0, emotion_share=0.0, speech_share=0.0, extreme_share=0.0)
    config = replace(config, shut_share=0.0, wink_share=0.0, half_shut_share=0.0, gaze_share=1.0)
    rows = [(e.strengths.get("eyeLookDownLeft", 0.0), e.strengths.get("eyeBlinkLeft", 0.0)) for e in drawn(800, config)]
    down, blink = np.array(rows).T
    assert blink[down > 0.4].mean() > blink[down == 0].mean() + 0.05


def test_eyes_are_shut_as_often_as_configured() -> None:
    shut = [min(e.strengths.get(f"eyeBlink{side}", 0.0) for side in SIDES) == 1 for e in drawn(1500)]
    assert abs(np.mean(shut) - DEFAULT_GEOMETRY.shut_share) < 0.02


mixtures = st.dictionaries(st.sampled_from(NAMES), st.floats(0, 2), max_size=20)


@given(mixtures)
def test_limits_hold_for_every_mixture(mixture: dict[str, float]) -> None:
    result = limited(mixture)
    assert all(0 < value <= 1 for value in result.values())
    assert result.get("mouthClose", 0.0) <= result.get("jawOpen", 0.0)
    assert not {"jawLeft", "jawRight"} <= result.keys()
    for side in SIDES:
        assert not {f"eyeLookUp{side}", f"eyeLookDown{side}"} <= result.keys()
    again = limited(result)
    assert again.keys() == result.keys()
    assert all(again[name] == pytest.approx(value) for name, value in result.items())


@given(mixtures)
def test_mirroring_twice_is_nothing(mixture: dict[str, float]) -> None:
    assert mirrored_strengths(mirrored_strengths(mixture)) == mixture


def test_a_mirrored_face_has_the_mirrored_strengths() -> None:
    model = builtin_model()
    assert model.symmetry is not None
    strengths = {"mouthSmileLeft": 0.8, "jawRight": 0.5, "eyeBlinkRight": 1.0, "jawOpen": 0.3}
    coefficients = np.stack([expression_of(model, s) for s in (strengths, mirrored_strengths(strengths))])
    face, other = model.vertices(np.zeros((2, model.n_identity)), coefficients)
    mirrored = face[model.symmetry] * [-1, 1, 1]
    assert np.abs(mirrored - other).mean() < 0.05
    assert np.abs(mirrored - face).mean() > 0.2


def test_strengths_in_attributes_are_those_of_the_coefficients() -> None:
    model = builtin_model()
    table = sample_faces(model, 30, 1, 128, DEFAULT_GEOMETRY)
    for index in range(30):
        attributes = json.loads(table.attributes[index])
        np.testing.assert_allclose(table.expression[index], expression_of(model, strengths_of(attributes)), atol=1e-5)
        assert isinstance(attributes["expression"], str)
        assert len(table.attributes[index]) < 1500
    assert strengths_of({}) == {}


def test_teeth_that_come_through_are_found_and_held_back() -> None:
    model = builtin_model()
    guard = ToothGuard(model)
    wide = {"jawOpen": 1.0, "mouthSmileLeft": 0.6, "mouthSmileRight": 0.6, "browDownLeft": 0.5}
    heads = np.clip(generator_for(0, "heads").standard_normal((40, model.n_identity)), -2.5, 2.5)
    through = [guard.comes_through(head, wide) for head in heads]
    assert 3 < sum(through) < 37
    assert not any(guard.comes_through(head, {}) for head in heads)
    for head, comes in zip(heads, through, strict=True):
        tamed = guard.tamed(head, wide)
        assert (tamed["jawOpen"] < 1) == comes
        assert tamed["browDownLeft"] == 0.5
        assert not guard.comes_through(head, tamed)


def frontal(middle_mm: float, height: int, px_per_mm: float) -> Camera:
    """Sees the part of a head about some height from the front."""
    middle = np.array([120, height / 2 + px_per_mm * middle_mm])
    return weak_perspective_camera(WeakPerspective(px_per_mm, rotation_of_pose(HeadPose(0, 0, 0)), middle))


@pytest.mark.gl
def test_shut_eyes_are_shut_whatever_the_gaze_and_the_head(gl) -> None:
    model = builtin_model()
    shut = replace(DEFAULT_GEOMETRY, shut_share=1.0, wink_share=0.0, half_shut_share=0.0, gaze_share=0.9)
    table = sample_faces(model, 150, 78, 128, shut)
    renderer, camera = Renderer(model, 100, 240, gl), frontal(27, 100, 2.0)
    eyes = [model.region_names.index(name) + 1 for name in ("eyes", "iris", "pupil")]
    vertices = model.vertices(table.identity, table.expression)
    visible = [np.isin(renderer.render(v, camera, ("regions",))["regions"], eyes).sum() for v in vertices]
    assert max(visible) == 0
    open_eyes = model.vertices(table.identity[:1], 0 * table.expression[:1])[0]
    assert np.isin(renderer.render(open_eyes, camera, ("regions",))["regions"], eyes).sum() > 200


@pytest.mark.gl
def test_no_tooth_comes_through_lip_or_chin_in_300_samples(gl) -> None:
    model = builtin_model()
    table = sample_faces(model, 300, 77, 128, DEFAULT_GEOMETRY)
    skin = np.isin(model.triangle_regions, [model.region_names.index(name) for name in ("skin", "lips")])
    outside = replace(
        model,
        triangles=np.ascontiguousarray(model.triangles[skin]),
        triangle_regions=np.ascontiguousarray(model.triangle_regions[skin]),
        uv=None,
        uv_triangles=None,
    )
    camera, is_tooth = frontal(-60, 240, 2.0), model.region_names.index("teeth") + 1
    whole, skin_only = (Renderer(m, 240, 240, gl) for m in (model, outside))
    n_wide = 0
    for index in range(300):
        strengths = strengths_of(json.loads(table.attributes[index]))
        if strengths.get("jawOpen", 0.0) <= 0.12:
            continue
        n_wide += 1
        vertices = model.vertices(table.identity[index][None], table.expression[index][None])[0]
        seen, behind = whole.render(vertices, camera, ("regions",)), skin_only.render(vertices, camera)
        tooth = (seen["regions"] == is_tooth) & behind["mask"]
        assert (behind["surface_depth"][tooth] - seen["surface_depth"][tooth] < 25).sum() <= 4, index
    assert n_wide >= 60
