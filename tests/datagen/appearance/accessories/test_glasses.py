from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from datagen.appearance.accessories.glasses import SHAPES, Glasses, draw_glasses
from datagen.appearance.accessories.glasses_meshes import glasses_meshes, outline
from tests.datagen.appearance.accessories.heads import outside_mm, random_head

SKIN = ("skin", "brows", "scalp", "neck")


def drawn(seed: int) -> Glasses:
    rng = np.random.default_rng(seed)
    return draw_glasses(rng, is_dark=seed % 3 == 0)


@pytest.mark.parametrize("seed", range(30))
def test_they_pass_beside_head_and_eyes(seed: int) -> None:
    head = random_head(seed)
    frame, lenses = glasses_meshes(drawn(seed), head)
    inside = outside_mm(frame.vertices, head, SKIN)
    assert inside.min() > -2.5  # at the root of the ear, where the nearest vertex misleads
    assert np.quantile(inside, 0.01) > -0.5
    assert outside_mm(lenses.vertices, head, (*SKIN, "eyes", "iris", "pupil")).min() > -0.5


@pytest.mark.parametrize("seed", range(20))
def test_they_sit_on_the_nose_before_the_eyes_and_reach_behind_the_ears(seed: int) -> None:
    head = random_head(seed)
    frame, lenses = glasses_meshes(replace(drawn(seed), lift=0.0, slip_mm=1.0, skew_deg=0.0), head)
    model = head.model
    eyes = model.vertices_of("iris", "pupil")
    near = cKDTree(lenses.vertices).query(head.vertices[eyes])[0]
    assert 5 < near.min() < 28
    ears = head.neutral[model.vertices_of("ears")]
    assert frame.vertices[:, 2].min() < np.median(ears[:, 2])
    assert frame.vertices[:, 0].min() < -60 < 60 < frame.vertices[:, 0].max()


def test_a_head_that_is_pierced_is_noticed() -> None:
    head = random_head(1)
    frame, _ = glasses_meshes(drawn(1), head)
    assert outside_mm(frame.vertices * [0.9, 1, 1], head, SKIN).min() < -3


@pytest.mark.parametrize("shape", SHAPES)
def test_outlines_fill_their_box(shape: str) -> None:
    points = outline(shape, 28)
    np.testing.assert_allclose(np.abs(points).max(axis=0), 1)
    area = 0.5 * abs(np.sum(points[:, 0] * np.roll(points[:, 1], -1) - points[:, 1] * np.roll(points[:, 0], -1)))
    assert 2.4 < area < 4


def test_dark_glasses_are_dark_and_others_mostly_clear() -> None:
    rng = np.random.default_rng(0)
    clear = [draw_glasses(rng, is_dark=False).lens_alpha for _ in range(200)]
    assert np.quantile(clear, 0.8) < 0.1
    assert min(draw_glasses(rng, is_dark=True).lens_alpha for _ in range(200)) >= 0.8
