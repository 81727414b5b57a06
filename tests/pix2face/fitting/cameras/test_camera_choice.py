"""Perspective is taken where the picture tells the distance, and only there."""

import numpy as np
import pytest

from pix2face.fitting.cameras.camera_choice import fit_warranted_camera, perspective_evidence
from pix2face.fitting.cameras.camera_fit import fit_affine_camera
from pix2face.fitting.cameras.pinhole_fit import fit_pinhole_camera
from pix2face.fitting.face_fit import fit_face
from pix2face.geometry.camera import HeadPose, Pinhole, pinhole_camera, pinhole_of, rotation_of_pose
from tests.benchmarks.closed_loop import with_noise
from tests.fits import paper_fit
from tests.pix2face.fitting.rendered_faces import render_known_face
from tests.synthetic_models import small_head_model

WIDTH_MM = 150.0
CENTRE = np.array([128.0, 128.0])


def face_like_points(n=1500):
    rng = np.random.default_rng(3)
    x, y = rng.uniform(-70, 70, n), rng.uniform(-90, 90, n)
    return np.column_stack([x, y, 100 - (x / 9) ** 2 - (y / 15) ** 2 + 20 * (np.abs(x) < 12)])


def seen_from(distance_mm, points, noise_px=0.0, seed=0):
    rotation = rotation_of_pose(HeadPose(5, 30, -8))
    centre = rotation @ points.mean(axis=0)
    camera = pinhole_camera(Pinhole(1.1 * distance_mm, CENTRE, rotation, np.array([0.0, 0, distance_mm]) - centre))
    noise = noise_px * np.random.default_rng(seed).standard_normal((len(points), 2))
    return camera, camera.project(points) + noise


@pytest.mark.parametrize("widths", [2, 4, 5.9])
@pytest.mark.parametrize("noise_px", [0.0, 0.3])
def test_near_faces_get_a_pinhole_with_their_focal_length(widths, noise_px):
    points = face_like_points()
    true, image = seen_from(widths * WIDTH_MM, points, noise_px)
    found = fit_warranted_camera(points, image, CENTRE, WIDTH_MM)
    assert not found.is_affine
    assert pinhole_of(found).focal_px == pytest.approx(pinhole_of(true).focal_px, rel=0.05)


@pytest.mark.parametrize("widths", [12, 40, 1000])
@pytest.mark.parametrize("noise_px", [0.0, 0.3, 2.0])
def test_far_faces_get_no_perspective(widths, noise_px):
    points = face_like_points()
    _, image = seen_from(widths * WIDTH_MM, points, noise_px)
    assert fit_warranted_camera(points, image, CENTRE, WIDTH_MM).is_affine


def test_noise_that_hides_the_distance_gets_no_perspective():
    points = face_like_points()
    _, image = seen_from(6 * WIDTH_MM, points, 6.0)
    assert fit_warranted_camera(points, image, CENTRE, WIDTH_MM).is_affine


@pytest.mark.parametrize("alike", [False, True])
def test_the_standard_error_is_the_spread_of_the_fits(alike):
    """Monte Carlo, with errors of their own for each point and with errors that patches of the picture share.

    Of shared errors the fit follows more than the estimate knows: it may be a third too small there, where one that
    took each point's error for its own would be a third of the truth.
    """
    points, ratios, estimates = face_like_points(600), [], []
    true, image = seen_from(4 * WIDTH_MM, points)
    patch = (image // 20).astype(int)
    for seed in range(60):
        rng = np.random.default_rng(seed)
        shared = rng.standard_normal((20, 20, 2))[patch[:, 0] % 20, patch[:, 1] % 20]
        noisy = image + 0.3 * (shared if alike else rng.standard_normal((len(points), 2)))
        found = fit_pinhole_camera(points, noisy, CENTRE, fit_affine_camera(points, noisy))
        estimates.append(perspective_evidence(found, points, noisy)[1])
        ratios.append(pinhole_of(true).translation_mm[2] / pinhole_of(found).translation_mm[2] - 1)
    assert (0.65 if alike else 0.75) < np.mean(estimates) / np.std(ratios) < 1.35


@pytest.mark.parametrize(("widths", "is_affine"), [(3, False), (5.9, False), (20, True)])
def test_from_maps(widths, is_affine):
    model = small_head_model()
    width = float(np.ptp(model.mean[model.is_face_vertex, 0]))
    face = render_known_face(model, HeadPose(4, -40, 10), 3, perspective=True, distance_mm=widths * width)
    for maps in (face.maps, with_noise(face.maps, model, 0.1, 0.05, 0)):
        fit = fit_face(
            maps, model, paper_fit(camera="auto", regularisation=1.0), principal_point_px=face.principal_point_px
        )
        assert fit.camera.is_affine == is_affine
        if not is_affine:
            assert pinhole_of(fit.camera).focal_px == pytest.approx(pinhole_of(face.camera).focal_px, rel=0.05)
