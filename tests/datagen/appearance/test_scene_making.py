"""Scenes of people, as the drawer takes them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from datagen.appearance.configuration import HARD, PRESETS
from datagen.appearance.light.head_occlusion import head_occlusion
from datagen.appearance.scene_making import SceneMaker
from datagen.appearance.skin.zones import head_paint
from datagen.appearance.whole import appearance_textures, draw_appearance
from datagen.opengl.gl_context import GLContext
from datagen.rendering.scene_drawing import SceneDrawer
from datagen.rendering.scene_openings import Openings
from datagen.sampling.faces import sample_faces
from pix2face.morphable_model import builtin_model

SIZE, SEED, N_FACES, N_OPEN = 128, 4, 80, 8


@pytest.mark.gl
def test_nobody_looks_into_a_head_through_its_neck(gl_session: GLContext) -> None:
    model, config = builtin_model(), PRESETS[HARD]
    maker, openings = SceneMaker(model), Openings(model)
    drawer = SceneDrawer(model, gl_session, appearance_textures(), head_paint(model), head_occlusion(model))
    table = sample_faces(model, N_FACES, SEED, SIZE, config.geometry)
    n_open = 0
    for index in range(N_FACES):
        face = table.face(index, Path())
        vertices = model.vertices(face.identity[None], face.expression[None])[0]
        if openings.box(vertices, face.camera, SIZE, SIZE) is None:
            continue
        scene = maker.scene(draw_appearance(SEED, face.sample_id, config), face, vertices)
        assert scene.has_body
        found = drawer.draw(scene, face.camera, SIZE, SIZE)
        looked_into = drawer.draw(replace(scene, has_body=False), face.camera, SIZE, SIZE)
        np.testing.assert_array_equal(found.labels, looked_into.labels)
        np.testing.assert_array_equal(found.radiance, looked_into.radiance)
        bare = drawer.draw(replace(scene, meshes=(), has_body=False), face.camera, SIZE, SIZE)
        closed = drawer.draw(replace(scene, meshes=()), face.camera, SIZE, SIZE)
        n_open += bool((bare.radiance != closed.radiance).any())  # without a body one would see it
        if n_open == N_OPEN:
            break
    assert n_open == N_OPEN
