"""Ambient occlusion: dark where a head is hollow, open where it is not, known for the built-in model alone."""

from dataclasses import replace

import numpy as np

from datagen.appearance.light.shading import head_occlusion
from pix2face.models.morphable_model import builtin_model
from tests.synthetic_models import small_head_model

IBUG = {"nose tip": 30, "chin": 8, "under the nose": 33, "inner corner": 39, "between the lips": 62}


def test_hollows_are_dark_and_what_sticks_out_is_not() -> None:
    model = builtin_model()
    occlusion = head_occlusion(model)
    assert occlusion.shape == (len(model.mean),)
    assert occlusion.min() >= 0
    assert occlusion.max() <= 1
    at = {name: float(occlusion[model.landmarks["ibug68"][place]]) for name, place in IBUG.items()}
    assert at["nose tip"] > 0.9
    assert at["under the nose"] < at["nose tip"] - 0.1
    assert at["inner corner"] < at["nose tip"] - 0.1
    assert at["between the lips"] < 0.75
    forehead = (model.mean[:, 1] > 60) & (model.mean[:, 2] > 80)
    assert occlusion[forehead].min() > 0.9
    under_chin = np.linalg.norm(model.mean - [0, -92, 50], axis=1) < 12
    assert occlusion[under_chin].mean() < 0.8


def test_front_teeth_are_lit_and_the_throat_is_not() -> None:
    model = builtin_model()
    occlusion = head_occlusion(model)
    teeth = np.unique(model.triangles[model.triangle_regions == model.region_names.index("teeth")])
    front, back = model.mean[teeth, 2] > 88, model.mean[teeth, 2] < 75
    assert occlusion[teeth[front]].max() > 2 * occlusion[teeth[back]].max()


def test_occlusion_is_symmetric_as_the_model_is() -> None:
    model = builtin_model()
    occlusion = head_occlusion(model)
    assert np.abs(occlusion - occlusion[model.symmetry]).mean() < 0.02


def test_another_model_is_taken_to_be_open() -> None:
    for model in (small_head_model(), replace(builtin_model(), sha256="0" * 64)):
        np.testing.assert_array_equal(head_occlusion(model), np.ones(len(model.mean), np.float32))
