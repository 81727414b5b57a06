import numpy as np
import pytest

from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.fitting.face_fit import fit_face
from pix2face.fitting.joint_fit import fit_joint
from pix2face.fitting.prepared_model import VertexGrid, patches_of, prepared_model
from pix2face.geometry.camera import HeadPose
from tests.fits import paper_fit
from tests.pix2face.fitting.rendered_faces import render_known_face
from tests.pix2face.fitting.test_noise import alike_over_patches
from tests.synthetic_models import small_head_model

MODEL = small_head_model()


def pictures(identity_seed, yaws, noise_mm):
    """One identity, an expression for each picture, errors of the network's kind."""
    out = []
    for index, yaw in enumerate(yaws):
        face = render_known_face(MODEL, HeadPose(0, yaw, 0), 50 + index, perspective=False, identity_seed=identity_seed)
        out.append((face, alike_over_patches(face.maps, noise_mm, 7 * identity_seed + index)))
    return out


def test_one_picture_jointly_is_one_picture():
    ((_, maps),) = pictures(1, [20], 0.5)
    (joint,), alone = (
        fit_joint([maps], MODEL, paper_fit(regularisation=3.0)),
        fit_face(maps, MODEL, paper_fit(regularisation=3.0)),
    )
    np.testing.assert_allclose(joint.identity, alone.identity, atol=1e-6)
    np.testing.assert_allclose(joint.expression, alone.expression, atol=1e-6)
    np.testing.assert_allclose(joint.landmarks2d, alone.landmarks2d, atol=1e-6)


def test_more_pictures_tell_the_identity_better():
    errors = {n: [] for n in (1, 2, 6)}
    for seed in range(4):
        seen = pictures(seed, [-50, 40, 0, 20, -25, 60], 1.5)
        for n in errors:
            fits = fit_joint((maps for _, maps in seen[:n]), MODEL, paper_fit())
            errors[n].append(np.sqrt(np.mean((fits[0].identity - seen[0][0].identity) ** 2)))
            assert all(np.array_equal(own.identity, fits[0].identity) for own in fits)
    means = [np.mean(errors[n]) for n in (1, 2, 6)]
    assert means[0] > means[1] > means[2]
    assert means[2] < 0.7 * means[0]


def test_a_noisy_picture_counts_less():
    (face, good), (_, other) = pictures(3, [0, 30], 0.1)
    bad = alike_over_patches(other, 8.0, 1)
    errors = [
        np.linalg.norm(fit_joint([good, bad], MODEL, paper_fit(regularisation=r))[0].identity - face.identity)
        for r in ("estimate", 10.0)
    ]
    assert errors[0] < errors[1]


def test_bad_input_is_refused():
    with pytest.raises(DegenerateGeometryError, match="found none"):
        fit_joint([], MODEL, paper_fit())
    with pytest.raises(UsageError, match="menpo84"):
        fit_joint([], MODEL, paper_fit(), scheme="menpo84")


def test_the_grid_knows_the_nearest_vertex():
    prepared = prepared_model(MODEL, 500)
    rng = np.random.default_rng(0)
    points = (prepared.mean[rng.integers(len(prepared.mean), size=2000)] + rng.normal(0, 1, (2000, 3))).astype(
        np.float32
    )
    found = VertexGrid.of(prepared.mean).look_up(points)
    assert (found >= 0).all()
    distance = np.linalg.norm(points[:, None] - prepared.mean[None], axis=2)
    # A cell answers for its centre, at most half its diagonal (1.8 mm) from the point.
    assert (distance[np.arange(2000), found] <= distance.min(axis=1) + 2 * 1.8).all()
    assert (found == distance.argmin(axis=1)).mean() > 0.75
    assert (VertexGrid.of(prepared.mean).look_up(np.float32([[0, 0, 0], [900, 0, 0], [0, -900, 5]])) == -1).all()


def test_prepared_models_are_remembered():
    assert prepared_model(MODEL, 500) is prepared_model(MODEL, 500)


def test_patches_are_compact_and_of_one_size():
    points = prepared_model(MODEL, 1000).mean
    patches = patches_of(points, 60)
    assert set(patches) == set(range(60))
    radius = [np.linalg.norm(points[patches == i] - points[patches == i].mean(axis=0), axis=1).max() for i in range(60)]
    assert max(radius) < 35
    assert len(patches_of(points[:0], 60)) == 0
    assert patches_of(points[:3], 60).max() == 2
