"""Samples of several faces at once."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.samples.baked_jitter import View
from datagen.samples.sample_making import SampleMaker
from datagen.samples.stage_times import StageTimes
from pix2face.face_files.coefficients import Face
from pix2face.geometry.camera import Camera, WeakPerspective, weak_perspective_camera
from pix2face.models.morphable_model import MorphableModel
from pix2face.shards.sample import Sample
from tests.synthetic_models import small_head_model

CAMERA = weak_perspective_camera(WeakPerspective(0.2, np.diag([1.0, -1.0, -1.0]), np.array([24.0, 32.0])))


def test_views_of_one_face_share_its_vertices(monkeypatch: pytest.MonkeyPatch) -> None:
    model, counts = small_head_model(), []
    one = Face(
        sample_id="one",
        identity=np.ones(model.n_identity, np.float32),
        expression=np.zeros(model.n_expression, np.float32),
        camera=CAMERA,
        height_px=64,
        width_px=48,
    )
    smaller = replace(one, sample_id="smaller", camera=Camera(np.diag([0.8, 0.8, 1, 1]) @ CAMERA.matrix))
    other = replace(one, sample_id="other", identity=-one.identity)
    vertices = MorphableModel.vertices

    def counted(self: MorphableModel, identity: np.ndarray, expression: np.ndarray) -> np.ndarray:
        counts.append(len(identity))
        return vertices(self, identity, expression)

    monkeypatch.setattr(MorphableModel, "vertices", counted)
    maker = SampleMaker(model, None, seed=0, layers=("pncc", "offset", "mask"))
    faces = [one, other, smaller, one]
    made = list(maker.make_all([View(face, face.sample_id) for face in faces], StageTimes()))
    assert counts == [2]
    for face, sample in zip(faces, made, strict=True):
        assert isinstance(sample, Sample)
        alone = maker.make(face)
        assert sample.sample_id == alone.sample_id == face.sample_id
        for name, values in alone.layers.items():
            np.testing.assert_allclose(sample.layers[name], values, atol=1e-4)
