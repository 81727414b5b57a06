from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from jaxtyping import Float64, Int
from numpy import ndarray

from pix2face.fitting.face_fit import FaceFit, face_of_coefficients
from pix2face.fitting.fit_options import LandmarkType
from pix2face.geometry.landmarks import IBUG68, IBUG68_2D, IBUG68_PARTS, INNER51
from pix2face.models.morphable_model import MorphableModel, builtin_model
from pix2face.models.rasterise import render_maps
from tests.cameras import posed_camera

JAW, INNER = list(IBUG68_PARTS["jaw"]), list(INNER51)
MARKED = builtin_model().landmarks[IBUG68_2D]
OFFSETS = builtin_model().landmark_offsets_mm[IBUG68_2D]


def fit_of_mean(yaw_deg: float, landmark_type: LandmarkType, model: MorphableModel | None = None) -> FaceFit:
    model = model or builtin_model()
    camera = posed_camera(150, 150, yaw_deg=yaw_deg)
    identity, expression = np.zeros(model.n_identity), np.zeros(model.n_expression)
    return face_of_coefficients(model, camera, identity, expression, landmark_type=landmark_type)


def project(fit: FaceFit, vertices: Int[ndarray, " n"], beside: float | ndarray = 0.0) -> Float64[ndarray, "n 2"]:
    return fit.camera.project(fit.vertices[vertices].astype(np.float64) + beside)


def test_jaw_points_of_a_frontal_face_stay():
    fit = fit_of_mean(0, "2d")
    moved = np.linalg.norm(fit.landmarks2d[JAW] - project(fit, MARKED[JAW]), axis=1)
    assert moved.max() < 4  # of 300 px


def test_jaw_points_on_the_far_side_of_a_turned_face_lie_at_its_edge():
    model, fit = builtin_model(), fit_of_mean(45, "2d")
    slid, fixed = fit.landmarks2d, project(fit, MARKED)
    moved = np.linalg.norm(slid - fixed, axis=1)[JAW]
    far = JAW[:8] if moved[:8].sum() > moved[9:].sum() else JAW[9:]
    mask = np.isfinite(render_maps(model, model.mean, fit.camera, 300, 300)["surface_depth"])
    edge = np.stack(np.nonzero(mask ^ np.roll(mask, 1, axis=1)), axis=1)[:, ::-1]
    to_edge = lambda points: np.array([np.linalg.norm(edge - point, axis=1).min() for point in points])  # noqa: E731
    upper = list(far)[:5] if far[0] == 0 else list(far)[-5:]
    assert moved[np.isin(JAW, upper)].mean() > 8
    assert to_edge(slid[upper]).mean() < 0.5 * to_edge(fixed[upper]).mean()


@pytest.mark.parametrize("yaw_deg", [0, 30])
def test_the_other_points_are_those_that_people_mark(yaw_deg):
    fixed, found = (fit_of_mean(yaw_deg, landmark_type) for landmark_type in ("3d", "2d"))
    marked = project(found, MARKED[INNER], OFFSETS[INNER])
    np.testing.assert_allclose(found.landmarks2d[INNER], marked, atol=1e-3)
    np.testing.assert_allclose(fixed.landmarks2d, project(fixed, builtin_model().landmarks[IBUG68]), atol=1e-3)
    np.testing.assert_array_equal(fit_of_mean(yaw_deg, "auto").landmarks2d, fixed.landmarks2d)
    np.testing.assert_array_equal(found.landmarks3d, fixed.landmarks3d)


def test_a_model_that_does_not_know_them_moves_the_jaw_alone():
    model = builtin_model()
    without = replace(model, landmarks=MappingProxyType({IBUG68: model.landmarks[IBUG68]}))
    fixed, slid = (fit_of_mean(45, landmark_type, without).landmarks2d for landmark_type in ("3d", "2d"))
    np.testing.assert_array_equal(slid[INNER], fixed[INNER])
    assert np.linalg.norm(slid - fixed, axis=1)[JAW].max() > 8
