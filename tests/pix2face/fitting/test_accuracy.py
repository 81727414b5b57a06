"""What docs/explanation/fitting.md claims of 200 faces, held on a few: the same faces, the same measure."""

import pytest

from pix2face.fitting.face_fit import fit_face
from pix2face.fitting.fit_options import EXACT_MAPS_REGULARISATION
from pix2face.models.morphable_model import builtin_model
from tests.benchmarks.closed_loop import MODELS, measure, summary
from tests.fits import paper_fit

N_FACES = 4
FULL_SIZE = pytest.mark.xdist_group("full size")  # the model is made once


@pytest.mark.parametrize("kind", ["affine", "weak-perspective", "pinhole"])
def test_exact_maps_give_the_face_back(kind):
    model = builtin_model()

    def fit(face, maps):
        return fit_face(
            maps,
            model,
            paper_fit(camera=kind, regularisation=EXACT_MAPS_REGULARISATION),
            principal_point_px=face.principal_point_px,
        )

    errors = summary(measure(model, N_FACES, fit, perspective=kind == "pinhole"))
    assert errors["reprojection_rms_px"]["largest"] < 0.05
    assert errors["visible_landmarks_percent"]["largest"] < 0.05
    assert errors["occluded_landmarks_percent"]["mean"] < 0.05
    assert errors["visible_vertices_95_percent_within_mm"]["largest"] < 0.05
    assert errors["visible_vertices_beyond_0.1_mm_percent"]["largest"] < 0.1
    assert errors["visible_vertices_largest_mm"]["largest"] < 0.2
    if kind == "pinhole":
        assert errors["focal_length_percent"]["largest"] < 1


@pytest.mark.parametrize("name", ["builtin", pytest.param("full-size", marks=FULL_SIZE)])
def test_noise_and_gross_outliers_leave_visible_landmarks_within_half_a_percent(name):
    model = MODELS[name]()
    errors = summary(measure(model, N_FACES, lambda _, maps: fit_face(maps, model, paper_fit()), 1.0, 0.05))
    assert errors["visible_landmarks_percent"]["largest"] < 0.5
    assert errors["visible_vertices_mean_mm"]["largest"] < 0.5
