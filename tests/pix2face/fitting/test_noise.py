from dataclasses import replace

import numpy as np
import pytest

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.face_fit import fit_face
from pix2face.fitting.noise import WHITE_NOISE_IS_STRONG_MM, white_noise_mm, without_white_noise
from pix2face.fitting.picture_measurement import measure_picture
from pix2face.geometry.camera import HeadPose
from tests.benchmarks.closed_loop import with_noise
from tests.fits import paper_fit
from tests.pix2face.fitting.rendered_faces import render_known_face
from tests.synthetic_models import small_head_model

MODEL = small_head_model()


@pytest.fixture(scope="module")
def faces():
    return [render_known_face(MODEL, HeadPose(0, yaw, 0), 30 + yaw, perspective=False) for yaw in (-25, 5, 40)]


def alike_over_patches(maps, noise_mm, seed, size_px=32):
    rng = np.random.default_rng(seed)
    coarse = rng.normal(0, noise_mm, (256 // size_px + 1, 256 // size_px + 1, 3))
    noise = np.kron(coarse, np.ones((size_px, size_px, 1)))[:256, :256].astype(np.float32)
    return replace(maps, offset=(maps.offset + noise) * maps.mask[:, :, None])


def estimate(maps):
    return measure_picture(maps, MODEL, paper_fit(camera="affine"), principal_point_px=None).regularisation


@pytest.mark.parametrize("noise_mm", [0.1, 0.5, 2.0])
def test_white_noise_is_measured(faces, noise_mm):
    for seed, face in enumerate(faces):
        assert white_noise_mm(with_noise(face.maps, MODEL, noise_mm, 0, seed)) == pytest.approx(noise_mm, rel=0.1)


def test_smooth_errors_are_no_white_noise(faces):
    for seed, face in enumerate(faces):
        assert white_noise_mm(face.maps) < 0.05
        assert white_noise_mm(alike_over_patches(face.maps, 1.5, seed)) < WHITE_NOISE_IS_STRONG_MM / 2


def test_the_filter_takes_noise_and_outliers_away_and_touches_nothing_else(faces):
    face = faces[0]
    assert without_white_noise(face.maps) is face.maps
    noisy = with_noise(face.maps, MODEL, 1.0, 0.05, 0)
    filtered = without_white_noise(noisy)
    inside = filtered.mask
    assert (inside & ~face.maps.mask).sum() == 0
    assert inside.sum() > 0.85 * face.maps.mask.sum()
    # Of a smooth map: the ellipsoid's folds (ears, nose) aside, which are a few percent of the pixels.
    errors = np.abs(filtered.offset - face.maps.offset)[inside]
    assert np.median(errors) < 0.25
    assert np.percentile(np.abs(noisy.offset - face.maps.offset)[inside], 99) > 3 > np.percentile(errors, 99.5)


@pytest.mark.parametrize(
    ("noise", "least", "most"),
    [
        (lambda maps, seed: maps, 1e-4, 0.05),
        (lambda maps, seed: with_noise(maps, MODEL, 0.2, 0, seed), 0.02, 0.12),  # variance 0.04
        (lambda maps, seed: alike_over_patches(maps, 0.5, seed), 0.5, 15),  # variance 0.25, shared by some 25 vertices
        (lambda maps, seed: alike_over_patches(maps, 2.0, seed), 8, 240),
    ],
)
def test_lambda_follows_the_noise(faces, noise, least, most):
    for seed, face in enumerate(faces):
        assert least <= estimate(noise(face.maps, seed)) <= most


@pytest.mark.parametrize("noise_mm", [0.3, 2.0])
@pytest.mark.parametrize("alike", [False, True])
def test_the_estimate_is_nearly_as_good_as_the_best_constant(faces, alike, noise_mm):
    """Over constants from 1e-3 to 1e3, each judged on the same faces."""

    def error(regularisation):
        total = 0.0
        for seed, face in enumerate(faces):
            make = alike_over_patches(face.maps, noise_mm, seed) if alike else None
            maps = with_noise(face.maps, MODEL, noise_mm, 0, seed) if make is None else make
            fit = fit_face(maps, MODEL, paper_fit(regularisation=regularisation))
            total += float(np.linalg.norm(fit.vertices - face.vertices, axis=1).mean())
        return total

    assert error("estimate") < 1.15 * min(error(constant) for constant in np.geomspace(1e-3, 1e3, 7))


def test_maps_that_are_not_finite_are_still_refused(faces):
    maps = with_noise(faces[0].maps, MODEL, 1.0, 0, 0)
    maps.offset[128, 128] = np.nan
    with pytest.raises(DegenerateGeometryError, match="finite"):
        fit_face(maps, MODEL, paper_fit())
