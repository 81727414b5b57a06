from dataclasses import replace

import numpy as np
import pytest

from pix2face.fitting import localise
from pix2face.fitting.localise import LEAST_PIXELS_A_VERTEX, VertexPixels, localise_prepared, valid_pixel_values
from pix2face.fitting.prepared_model import prepared_model, spread_vertices
from pix2face.geometry.camera import HeadPose
from tests.pix2face.fitting.rendered_faces import render_known_face
from tests.synthetic_models import small_head_model

FRONTAL = HeadPose(5, 10, -5)


@pytest.fixture(scope="module")
def model():
    return small_head_model()


@pytest.fixture(scope="module")
def face(model):
    return render_known_face(model, FRONTAL, 1, perspective=False)


def localised(maps, model) -> VertexPixels:
    return localise_prepared(maps, valid_pixel_values(maps), prepared_model(model, 10_000))


def found_vertices(found, model):
    return spread_vertices(model, 10_000)[found.places]


def pixel_errors(face, found, model):
    return np.linalg.norm(face.camera.project(face.vertices[found_vertices(found, model)]) - found.points2d, axis=1)


@pytest.fixture(params=[LEAST_PIXELS_A_VERTEX, 1000], ids=["grid", "tree"])
def least_share(request, monkeypatch) -> float:
    """Pixels are looked up in the grid, then in the tree; the least share of the vertices found in noise."""
    monkeypatch.setattr(localise, "LEAST_PIXELS_A_VERTEX", request.param)
    return 0.85 if request.param == LEAST_PIXELS_A_VERTEX else 0.9


@pytest.mark.usefixtures("least_share")
def test_vertices_are_found_to_a_fraction_of_a_pixel(face, model):
    found = localised(face.maps, model)
    errors = pixel_errors(face, found, model)
    assert np.median(errors) < 0.03
    assert np.percentile(errors, 90) < 0.25
    true_offsets = (face.vertices - model.mean)[found_vertices(found, model)]
    assert np.percentile(np.linalg.norm(found.offsets - true_offsets, axis=1), 90) < 0.15


def test_refinement_is_better_than_the_nearest_pixel(face, model):
    found = localised(face.maps, model)
    centres = np.floor(found.points2d) + 0.5
    to_centres = np.linalg.norm(face.camera.project(face.vertices[found_vertices(found, model)]) - centres, axis=1)
    assert np.median(pixel_errors(face, found, model)) < 0.1 * np.median(to_centres)


@pytest.mark.parametrize("yaw", [-70, 70])
def test_hidden_vertices_are_left_out(model, yaw):
    face = render_known_face(model, HeadPose(0, yaw, 0), 2, perspective=False)
    found = localised(face.maps, model)
    away = np.sign(model.mean[:, 0]) == np.sign(-yaw)  # positive yaw shows the subject's left side
    visible = np.zeros(len(model.mean), dtype=bool)
    visible[found_vertices(found, model)] = True
    far_side = spread_vertices(model, 10_000)
    far_side = far_side[np.abs(model.mean[far_side, 0]) > 45]
    shares = [visible[far_side[away[far_side] == side]].mean() for side in (False, True)]
    assert min(shares) < 0.02
    assert max(shares) > 0.9
    assert np.percentile(pixel_errors(face, found, model), 98) < 2.5


def test_a_fold_is_not_interpolated_across(model):
    """Two half planes of the face, one of them 40 mm behind: the offsets of both sides stay apart."""
    face = render_known_face(model, HeadPose(0, 0, 0), 3, perspective=False)
    offset = face.maps.offset.copy()
    pncc = face.maps.pncc.copy()
    right = np.arange(256) >= 128
    pncc[:, right] += np.float32([0, 0, -40])
    offset[:, right] += np.float32(30)
    maps = replace(face.maps, pncc=pncc * face.maps.mask[..., None], offset=offset * face.maps.mask[..., None])
    found = localised(maps, model)
    on_left = found.points2d[:, 0] < 127
    true_offsets = (face.vertices - model.mean)[found_vertices(found, model)]
    assert np.abs(found.offsets - true_offsets)[on_left].max() < 5
    assert on_left.sum() > 100


def test_the_limit_follows_the_noise(face, model, least_share):
    rng = np.random.default_rng(0)
    noisy = face.maps.pncc + rng.normal(size=face.maps.pncc.shape).astype(np.float32) * 2
    maps = replace(face.maps, pncc=noisy * face.maps.mask[..., None])
    found = localised(maps, model)
    exact = localised(face.maps, model)
    assert len(found.places) > least_share * len(exact.places)


def test_values_outside_the_mask_do_not_matter(face, model):
    pncc = np.where(face.maps.mask[..., None], face.maps.pncc, np.float32(np.nan))
    found = localised(replace(face.maps, pncc=pncc), model)
    expected = localised(face.maps, model)
    np.testing.assert_array_equal(found.places, expected.places)
    np.testing.assert_allclose(found.points2d, expected.points2d)


def test_one_pixel_of_face_is_no_crash(face, model):
    mask = np.zeros_like(face.maps.mask)
    mask[128, 128] = True
    found = localised(replace(face.maps, mask=mask), model)
    assert np.isfinite(found.offsets).all()
