import numpy as np

from pix2face.fitting.face_fit import FaceFit, face_of_coefficients
from pix2face.fitting.fit_options import Contour
from pix2face.geometry.landmarks import IBUG68_PARTS, INNER51
from pix2face.models.morphable_model import builtin_model
from pix2face.models.rasterise import render_maps
from tests.cameras import posed_camera

JAW = list(IBUG68_PARTS["jaw"])


def fit_of_mean(yaw_deg: float, contour: Contour) -> FaceFit:
    model = builtin_model()
    camera = posed_camera(150, 150, yaw_deg=yaw_deg)
    identity, expression = np.zeros(model.n_identity), np.zeros(model.n_expression)
    return face_of_coefficients(model, camera, identity, expression, contour=contour)


def test_jaw_points_of_a_frontal_face_stay():
    moved = np.linalg.norm(fit_of_mean(0, "2d").landmarks2d - fit_of_mean(0, "off").landmarks2d, axis=1)
    assert moved.max() < 4  # of 300 px


def test_jaw_points_on_the_far_side_of_a_turned_face_lie_at_its_edge():
    model, fit = builtin_model(), fit_of_mean(45, "off")
    slid = fit_of_mean(45, "2d").landmarks2d
    np.testing.assert_array_equal(slid[list(INNER51)], fit.landmarks2d[list(INNER51)])
    moved = np.linalg.norm(slid - fit.landmarks2d, axis=1)[JAW]
    far = JAW[:8] if moved[:8].sum() > moved[9:].sum() else JAW[9:]
    mask = np.isfinite(render_maps(model, model.mean, fit.camera, 300, 300)["surface_depth"])
    edge = np.stack(np.nonzero(mask ^ np.roll(mask, 1, axis=1)), axis=1)[:, ::-1]
    to_edge = lambda points: np.array([np.linalg.norm(edge - point, axis=1).min() for point in points])  # noqa: E731
    upper = list(far)[:5] if far[0] == 0 else list(far)[-5:]
    assert moved[np.isin(JAW, upper)].mean() > 8
    assert to_edge(slid[upper]).mean() < 0.5 * to_edge(fit.landmarks2d[upper]).mean()
