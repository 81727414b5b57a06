import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.least_squares.linear_system import ROBUST_ROUNDS, JointAccumulator, image_system
from pix2face.fitting.prepared_model import vertex_basis
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
VERTICES = np.flatnonzero(MODEL.is_face_vertex)[::3]


def system_of(vertices, offsets, regularisation, *, robust=True):
    basis = vertex_basis(MODEL, vertices).astype(np.float64)
    return image_system(basis, offsets, regularisation, robust_rounds=ROBUST_ROUNDS if robust else 0)


def fit_coefficients(vertices, offsets, regularisation, *, robust=True):
    return system_of(vertices, offsets, regularisation, robust=robust).solve(regularisation)


def random_face(seed):
    rng = np.random.default_rng(seed)
    identity, expression = rng.normal(size=MODEL.n_identity), rng.normal(size=MODEL.n_expression)
    offsets = (MODEL.vertices(identity[None], expression[None])[0] - MODEL.mean)[VERTICES]
    return identity, expression, offsets.astype(np.float64), rng


@given(st.integers(0, 1000))
def test_exact_offsets_give_the_coefficients_back(seed):
    identity, expression, offsets, _ = random_face(seed)
    found = fit_coefficients(VERTICES, offsets, 1e-6)
    np.testing.assert_allclose(found, np.concatenate([identity, expression]), atol=1e-3)


def test_minimises_its_cost():
    _, _, offsets, rng = random_face(1)
    offsets += rng.normal(size=offsets.shape)
    regularisation = 30.0
    best = fit_coefficients(VERTICES, offsets, regularisation, robust=False)

    def cost(c):
        k = MODEL.n_identity
        face = MODEL.vertices(c[None, :k], c[None, k:])[0] - MODEL.mean
        return ((face[VERTICES] - offsets) ** 2).sum() + regularisation * c @ c

    for _ in range(30):
        assert cost(best + 0.05 * rng.normal(size=len(best))) > cost(best)


def test_the_noise_variance_is_the_best_regularisation():
    """The rule beside the constants: independent errors of variance v are served best by lambda = v."""
    few = np.flatnonzero(MODEL.is_face_vertex)[::40]
    sigma, errors = 6.0, {}
    for factor in (1 / 25, 1, 25):
        total = 0.0
        for seed in range(60):
            rng = np.random.default_rng(seed)
            c = rng.normal(size=(1, MODEL.n_identity)), rng.normal(size=(1, MODEL.n_expression))
            offsets = (MODEL.vertices(*c)[0] - MODEL.mean)[few] + rng.normal(size=(len(few), 3)) * sigma
            found = fit_coefficients(few, offsets.astype(np.float64), factor * sigma**2, robust=False)
            total += float(((found - np.concatenate([c[0][0], c[1][0]])) ** 2).sum())
        errors[factor] = total
    assert errors[1] < errors[1 / 25]
    assert errors[1] < errors[25]


def test_wrong_vertices_lose_their_weight():
    identity, expression, offsets, rng = random_face(4)
    offsets += 0.02 * rng.normal(size=offsets.shape)
    wrong = rng.uniform(size=len(offsets)) < 0.1
    offsets[wrong] += 5 * rng.normal(size=(wrong.sum(), 3))
    true = np.concatenate([identity, expression])
    errors = {
        robust: np.abs(fit_coefficients(VERTICES, offsets, 1e-3, robust=robust) - true).max()
        for robust in (True, False)
    }
    assert errors[True] < 0.02
    assert errors[True] < 0.1 * errors[False]


def test_more_regularisation_means_smaller_coefficients():
    _, _, offsets, _ = random_face(2)
    sizes = [np.linalg.norm(fit_coefficients(VERTICES, offsets, r)) for r in (1e-3, 1e3, 1e6)]
    assert sizes[0] > sizes[1] > sizes[2]


def test_bad_input_is_refused():
    _, _, offsets, _ = random_face(3)
    with pytest.raises(DegenerateGeometryError, match="found none"):
        fit_coefficients(VERTICES[:0], offsets[:0], 1.0)
    with pytest.raises(DegenerateGeometryError, match="positive regularisation, found 0"):
        fit_coefficients(VERTICES, offsets, 0.0)
    with pytest.raises(DegenerateGeometryError, match="positive regularisation, found inf"):
        fit_coefficients(VERTICES, offsets, np.inf)
    with pytest.raises(DegenerateGeometryError, match="found 1e-300; take a larger one"):
        fit_coefficients(VERTICES[:2], offsets[:2], 1e-300)
    with pytest.raises(DegenerateGeometryError, match="3 values that are not finite"):
        fit_coefficients(VERTICES, np.where(np.arange(len(offsets))[:, None] == 4, np.nan, offsets), 1.0)


def joint_system_in_full(images, regularisation):
    """Eq. 5 as it stands in the paper, with Tikhonov's rows below: the slow twin of the elimination."""
    k, e, n = MODEL.n_identity, MODEL.n_expression, len(images)
    rows = []
    for i, (vertices, _) in enumerate(images):
        a = MODEL.identity_basis[:, vertices].reshape(k, -1).T
        b = MODEL.expression_basis[:, vertices].reshape(e, -1).T
        blocks = [b if i == j else np.zeros_like(b) for j in range(n)]
        rows.append(np.concatenate([a, *blocks], axis=1))
    matrix = np.concatenate([*rows, np.sqrt(regularisation) * np.eye(k + n * e)])
    right = np.concatenate([*[offsets.reshape(-1) for _, offsets in images], np.zeros(k + n * e)])
    solution = np.linalg.lstsq(matrix, right, rcond=None)[0]
    return solution[:k], solution[k:].reshape(n, e)


def joint_coefficients(images, regularisation, *, robust=True):
    joint = JointAccumulator(MODEL.n_identity)
    for vertices, offsets in images:
        joint.add(system_of(vertices, offsets, regularisation, robust=robust), regularisation)
    return joint.solve()


@pytest.mark.parametrize("regularisation", [1e-2, 50.0])
def test_elimination_solves_the_joint_system(regularisation):
    rng = np.random.default_rng(4)
    images = []
    for count in (300, 80, 500):
        vertices = rng.choice(VERTICES, count)
        images.append((vertices, 5 * rng.normal(size=(count, 3))))
    identity, expressions = joint_coefficients(images, regularisation, robust=False)
    expected_identity, expected_expressions = joint_system_in_full(images, regularisation)
    np.testing.assert_allclose(identity, expected_identity, atol=1e-5)
    np.testing.assert_allclose(expressions, expected_expressions, atol=1e-5)


def test_several_images_tell_the_identity_better_than_one():
    rng = np.random.default_rng(5)
    sides = [VERTICES[MODEL.mean[VERTICES, 0] > 30], VERTICES[MODEL.mean[VERTICES, 0] < -30]]
    joint_error, single_error = 0.0, 0.0
    for _ in range(20):
        identity = rng.normal(size=(1, MODEL.n_identity))
        images = []
        for side in sides:
            face = MODEL.vertices(identity, rng.normal(size=(1, MODEL.n_expression)))[0]
            images.append((side, ((face - MODEL.mean)[side] + 3 * rng.normal(size=(len(side), 3))).astype(np.float64)))
        joint_error += np.linalg.norm(joint_coefficients(images, 9.0)[0] - identity[0])
        single_error += np.linalg.norm(fit_coefficients(*images[0], 9.0)[: MODEL.n_identity] - identity[0])
    assert joint_error < 0.9 * single_error


def test_joint_fit_refuses_nothing_to_fit():
    _, _, offsets, _ = random_face(3)
    with pytest.raises(DegenerateGeometryError, match="found none"):
        joint_coefficients([], 1.0)
    with pytest.raises(DegenerateGeometryError, match="found none"):
        joint_coefficients([(VERTICES, offsets), (VERTICES[:0], offsets[:0])], 1.0)
