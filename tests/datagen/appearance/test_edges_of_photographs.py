"""Photographs of sampled people: from the scene to the file, edges stay where the maps have them."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy import ndarray

from datagen.appearance.appearance import appearance_textures, draw_appearance
from datagen.appearance.appearance_config import DEFAULT, HARD, PRESETS
from datagen.appearance.light.shading import head_occlusion
from datagen.appearance.photograph.border import Border
from datagen.appearance.photograph.faults import draw_photograph
from datagen.appearance.photograph.photograph import develop
from datagen.appearance.photograph.photograph_config import HARD_PHOTOGRAPH, PhotographConfig
from datagen.appearance.scene import HEAD
from datagen.appearance.scene_making import SceneMaker
from datagen.appearance.skin.zones import head_paint
from datagen.opengl.gl_context import GLContext
from datagen.rendering.renderer import Renderer
from datagen.rendering.scenes.scene_drawing import SceneDrawer
from datagen.sampling.faces import sample_faces
from pix2face.models.morphable_model import builtin_model
from tests.datagen.rendering.edges import FINER, edge_offsets, true_coverage

MODEL = builtin_model()
SIZE, SEED, N_PEOPLE = 96, 11, 16


@pytest.mark.gl
@pytest.mark.parametrize("preset", [DEFAULT, HARD])
def test_people_end_where_their_maps_end(gl: GLContext, preset: str) -> None:
    """Wherever nothing but the head and what is behind it is near: no hair, no clothes, nothing before the face."""
    config = PRESETS[preset]
    table = sample_faces(MODEL, N_PEOPLE, SEED, SIZE, config.geometry)
    scenes, finer = SceneMaker(MODEL), Renderer(MODEL, SIZE * FINER, SIZE * FINER, gl)
    drawer = SceneDrawer(MODEL, gl, appearance_textures(), head_paint(MODEL), head_occlusion(MODEL))
    found = []
    for index, vertices in enumerate(MODEL.vertices(table.identity, table.expression)):
        face = table.face(index, Path())
        scene = scenes.scene(draw_appearance(SEED, face.sample_id, config), face, vertices)
        picture = drawer.draw(scene, face.camera, SIZE, SIZE)
        head, _ = true_coverage(finer, vertices, face.camera)
        others = ((picture.labels != HEAD) & (picture.labels != 0)).astype(np.uint8)
        alone = cv2.dilate(others, np.ones((9, 9), np.uint8)) == 0
        found.append(edge_offsets(picture.coverage, head, alone))
    offsets = np.concatenate(found)
    assert len(offsets) > 1000
    assert np.abs(offsets).max() < 0.5
    assert np.quantile(np.abs(offsets), 0.9) < 0.2


def shift_of_a_disc(config: PhotographConfig, index: int) -> ndarray:
    """By how much what happens to a photograph moves a light disc, px: contrast swells it, but not to one side."""
    photograph = draw_photograph(np.random.default_rng([SEED, index]), config)
    photograph = replace(photograph, border=Border(), processing=replace(photograph.processing, text=""))
    middle, side = np.array([31.4, 29.8]), 64
    fine = np.hypot(*(((np.mgrid[: 8 * side, : 8 * side] + 0.5) / 8) - middle[::-1, None, None])) < 14
    disc = cv2.resize(fine.astype(np.float32), (side, side), interpolation=cv2.INTER_AREA)
    light = (0.03 + 0.4 * disc)[..., None] * np.array([1, 0.9, 0.8], dtype=np.float32)
    shown = develop(light, photograph, disc > 0.5).mean(axis=2)
    rows, columns = np.mgrid[:side, :side] + 0.5
    away = np.hypot(columns - middle[0], rows - middle[1])
    inside, outside = np.median(shown[away < 9]), np.median(shown[(away > 20) & (away < 26)])
    share = np.clip((shown - outside) / (inside - outside), 0, 1)
    share[(away > 21) | (share < 0.25)] = 0
    return np.array([(share * columns).sum(), (share * rows).sum()]) / share.sum() - middle


def test_no_step_after_the_drawing_moves_an_edge() -> None:
    """Neither the lens, nor resampling, nor a program's filters: what is left is shading, noise and blur."""
    decent, bad = (
        np.array([shift_of_a_disc(config, index) for index in range(100)])
        for config in (PhotographConfig(), HARD_PHOTOGRAPH)
    )
    assert np.abs(decent).max() < 0.3
    assert np.quantile(np.abs(bad), 0.95) < 0.5
    for shifts in (decent, bad):
        assert np.abs(shifts.mean(axis=0)).max() < 0.05
