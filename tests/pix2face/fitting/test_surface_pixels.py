"""Pixels on the surface of the mean face, and what exact maps give back through them."""

import numpy as np
import pytest

from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.fitting.face_fit import fit_face
from pix2face.fitting.localise import valid_pixel_values
from pix2face.fitting.surface_pixels import _place_on_surface, surface_rows
from pix2face.geometry.camera import HeadPose
from tests.benchmarks.closed_loop import MODELS, measure, summary, with_noise
from tests.fits import paper_fit
from tests.pix2face.fitting.rendered_faces import render_known_face
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
FULL_SIZE = pytest.mark.xdist_group("full size")  # the model is made once


def test_points_are_placed_where_they_were_taken():
    rng = np.random.default_rng(0)
    triangles = np.flatnonzero(MODEL.is_face_triangle)[::7]
    weights = rng.dirichlet([2, 2, 2], len(triangles))
    points = np.einsum("nk,nkc->nc", weights, MODEL.mean.astype(np.float64)[MODEL.triangles[triangles]])
    found, barycentric = _place_on_surface(MODEL, points)
    placed = found >= 0
    assert placed.mean() > 0.95  # a sliver's nearest vertex may belong to another triangle: such points are left out
    np.testing.assert_array_equal(found[placed], triangles[placed])
    np.testing.assert_allclose(barycentric[placed], weights[placed], atol=1e-4)


def test_points_off_the_surface_are_left_out():
    points = MODEL.mean[MODEL.is_face_vertex][::9].astype(np.float64) * 1.01
    assert (_place_on_surface(MODEL, points)[0] == -1).all()


def test_rows_explain_the_offsets_to_the_rounding_of_the_maps():
    face = render_known_face(MODEL, HeadPose(0, 30, 0), 2, perspective=True)
    rows, offsets = surface_rows(MODEL, valid_pixel_values(face.maps), 3000)
    assert len(rows) > 2500
    difference = rows @ np.concatenate([face.identity, face.expression]) - offsets
    assert np.sqrt(np.mean(difference**2)) < 0.005


@pytest.mark.parametrize(("name", "n_faces"), [("builtin", 4), pytest.param("full-size", 3, marks=FULL_SIZE)])
def test_exact_maps_give_everything_back(name, n_faces):
    model = MODELS[name]()
    errors = summary(measure(model, n_faces, lambda _, maps: fit_face(maps, model, paper_fit(), constraints="surface")))
    assert errors["reprojection_rms_px"]["largest"] < 0.005
    assert errors["visible_landmarks_percent"]["largest"] < 0.005
    assert errors["occluded_landmarks_percent"]["mean"] < 0.05
    assert errors["visible_vertices_largest_mm"]["largest"] < 0.05


def test_misuse_is_refused():
    face = render_known_face(MODEL, HeadPose(0, 30, 0), 2, perspective=False)
    with pytest.raises(UsageError, match="reprojection"):
        fit_face(face.maps, MODEL, paper_fit(reprojection_rounds=1), constraints="surface")
    far_off = with_noise(face.maps, MODEL, 0, 0, 0)
    far_off.pncc[:] *= np.float32(1.1)
    with pytest.raises(DegenerateGeometryError, match="found none"):
        fit_face(far_off, MODEL, paper_fit(), constraints="surface")
