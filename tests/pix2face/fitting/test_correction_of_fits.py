"""What a network says of a fit changes the camera and the system that coefficients are solved from."""

from dataclasses import replace

import numpy as np
import pytest

from pix2face.fitting.face_fit import fit_face
from pix2face.fitting.fit_options import FitOptions
from pix2face.fitting.joint_fit import fit_joint
from pix2face.fitting.picture_measurement import measure_picture
from pix2face.geometry.camera import Camera, HeadPose
from pix2face.geometry.maps import FaceMaps
from pix2face.models.morphable_model import builtin_model
from tests.pix2face.fitting.rendered_faces import render_known_face

MODEL = builtin_model()
CHANGE = np.linspace(-0.5, 0.5, MODEL.n_identity + MODEL.n_expression)
SHIFT = np.array([[1.0, 0, 3.0], [0, 1, -2.0], [0, 0, 1]])


def correct(camera: Camera, coefficients: np.ndarray) -> tuple[Camera, np.ndarray]:
    return camera.transformed(SHIFT), coefficients + CHANGE


@pytest.fixture(scope="module")
def maps() -> FaceMaps:
    return render_known_face(MODEL, HeadPose(5, 20, -5), 4, perspective=False).maps


def test_camera_and_coefficients_are_the_corrected_ones(maps: FaceMaps) -> None:
    before, after = (measure_picture(own, MODEL, FitOptions()) for own in (maps, replace(maps, correct=correct)))
    np.testing.assert_allclose(after.camera.matrix, before.camera.transformed(SHIFT).matrix)
    np.testing.assert_allclose(after.coefficients, before.coefficients + CHANGE)
    # Whoever solves the system again, such as a fit of several pictures, gets them too.
    np.testing.assert_allclose(after.system.solve(after.regularisation), after.coefficients, atol=1e-8)
    np.testing.assert_array_equal(after.system.normal, before.system.normal)


def test_fits_of_one_and_of_several_pictures_are_corrected(maps: FaceMaps) -> None:
    corrected = replace(maps, correct=correct)
    one = fit_face(corrected, MODEL)
    several, _ = fit_joint([corrected, corrected], MODEL)
    expected = fit_face(maps, MODEL).identity + CHANGE[: MODEL.n_identity]
    np.testing.assert_allclose(one.identity, expected)
    assert np.corrcoef(several.identity, expected)[0, 1] > 0.99


@pytest.mark.parametrize(
    "options", [FitOptions(correction=False), FitOptions(silhouette=False), FitOptions(camera="affine")]
)
def test_other_fits_are_not_corrected(maps: FaceMaps, options: FitOptions) -> None:
    found, expected = (fit_face(own, MODEL, options) for own in (replace(maps, correct=correct), maps))
    np.testing.assert_array_equal(found.landmarks2d, expected.landmarks2d)
