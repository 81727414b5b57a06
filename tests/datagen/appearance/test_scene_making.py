"""Scenes of people, as the drawer takes them."""

from pathlib import Path

import numpy as np
import pytest

from datagen.appearance.appearance import appearance_textures, draw_appearance
from datagen.appearance.appearance_config import HARD, PRESETS
from datagen.appearance.light.shading import head_occlusion
from datagen.appearance.scene_making import SceneMaker
from datagen.appearance.skin.zones import head_paint
from datagen.opengl.gl_context import GLContext
from datagen.rendering.scenes.scene_drawing import SceneDrawer
from datagen.sampling.faces import sample_faces
from pix2face.models.morphable_model import builtin_model

SIZE, SEED = 128, 4
MODEL = builtin_model()


@pytest.fixture(scope="module")
def drawer(gl_session: GLContext) -> SceneDrawer:
    return SceneDrawer(MODEL, gl_session, appearance_textures(), head_paint(MODEL), head_occlusion(MODEL))


@pytest.mark.gl
def test_what_was_drawn_before_does_not_matter(drawer: SceneDrawer) -> None:
    config, table = PRESETS[HARD], sample_faces(MODEL, 12, SEED, SIZE, PRESETS[HARD].geometry)
    faces = [table.face(index, Path()) for index in range(12)]
    maker, vertices = SceneMaker(MODEL), MODEL.vertices(table.identity, table.expression)
    scenes = [
        maker.scene(draw_appearance(SEED, face.sample_id, config), face, own)
        for face, own in zip(faces, vertices, strict=True)
    ]
    kinds = [{mesh.material.kind for mesh in scene.meshes} for scene in scenes]
    assert {"glass" in kind for kind in kinds} == {False, True}  # programs are idle in some and not in others
    first, again = (
        [drawer.draw(scenes[place], faces[place].camera, SIZE, SIZE) for place in order]
        for order in (range(12), range(11, -1, -1))
    )
    for one, other in zip(first, reversed(again), strict=True):
        np.testing.assert_array_equal(one.radiance, other.radiance)
        np.testing.assert_array_equal(one.labels, other.labels)
