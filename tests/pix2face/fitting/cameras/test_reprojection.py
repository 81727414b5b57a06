"""The mesh held to the pixels where its vertices were found."""

from dataclasses import replace

import numpy as np
import pytest

from pix2face.fitting.cameras.reprojection import _projection
from pix2face.fitting.face_fit import fit_face
from pix2face.geometry.camera import HeadPose
from tests.fits import paper_fit
from tests.pix2face.fitting.rendered_faces import render_known_face
from tests.synthetic_models import small_head_model

MODEL = small_head_model()


def landmark_error(face, maps, **options):
    fit = fit_face(maps, MODEL, paper_fit(**options), principal_point_px=face.principal_point_px)
    seen = face.is_visible(MODEL)[MODEL.landmarks["ibug68"]]
    return float(np.linalg.norm(fit.landmarks2d - face.landmarks2d(MODEL), axis=1)[seen].mean())


@pytest.mark.parametrize("kind", ["affine", "weak-perspective", "pinhole"])
@pytest.mark.parametrize("yaw_deg", [0, 45])
def test_shrunken_offsets_are_made_up_for_by_the_picture(kind, yaw_deg):
    """Half the offset, as networks that were stopped early predict it."""
    face = render_known_face(MODEL, HeadPose(0, yaw_deg, 0), 8, perspective=kind == "pinhole")
    maps = replace(face.maps, offset=face.maps.offset / 2)
    errors = [landmark_error(face, maps, camera=kind, regularisation=5.0, reprojection_rounds=n) for n in (0, 1, 2)]
    assert errors[1] < 0.75 * errors[0]
    assert errors[2] < 1.02 * errors[1]


def test_exact_maps_stay_exact():
    face = render_known_face(MODEL, HeadPose(5, -30, 10), 9, perspective=False)
    assert landmark_error(face, face.maps, regularisation=1e-4, reprojection_rounds=2) < 0.1


def test_the_derivative_of_the_projection():
    face = render_known_face(MODEL, HeadPose(5, -30, 10), 9, perspective=True)
    points = MODEL.mean[::50].astype(np.float64)
    derivative, images = _projection(face.camera, points)
    np.testing.assert_allclose(images, face.camera.project(points))
    for axis in range(3):
        step = 1e-4 * np.eye(3)[axis]
        difference = (face.camera.project(points + step) - face.camera.project(points - step)) / 2e-4
        np.testing.assert_allclose(derivative[:, :, axis], difference, atol=1e-6)
