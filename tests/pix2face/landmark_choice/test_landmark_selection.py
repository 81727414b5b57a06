import numpy as np
import pytest

from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.landmark_choice.landmark_selection import MirrorImages, ReprojectionErrors, fold_of_frame

N_VERTICES = 40
TRUE = np.array([3, 17, 8])
CANDIDATES = np.arange(0, 2 * N_VERTICES, 2)


def errors_of_frames(n_frames: int, noise: float, n_folds: int = 4, seed: int = 0) -> ReprojectionErrors:
    """Frames of random faces of several sizes, whose landmarks are three of the candidates, with noise."""
    rng = np.random.default_rng(seed)
    errors = ReprojectionErrors(CANDIDATES, len(TRUE), n_folds)
    face = rng.normal(size=(N_VERTICES, 2))
    for index in range(n_frames):
        size = rng.uniform(20, 300)
        projected = size * (face + 0.05 * rng.normal(size=face.shape)) + rng.uniform(-50, 50, 2)
        annotated = projected[TRUE] + size * noise * rng.normal(size=(len(TRUE), 2))
        errors.add(fold_of_frame(index, n_frames, n_folds), projected, annotated)
    return errors


def test_the_vertices_that_frames_were_annotated_at_are_found():
    selection = errors_of_frames(40, noise=0.05).select()
    np.testing.assert_array_equal(selection.vertices, CANDIDATES[TRUE])
    np.testing.assert_array_equal(selection.n_frames, [40, 40, 40])


def test_without_noise_the_error_is_zero():
    selection = errors_of_frames(8, noise=0.0).select()
    np.testing.assert_allclose(selection.error, 0, atol=1e-12)
    np.testing.assert_allclose(selection.held_out_error, 0, atol=1e-12)


def test_the_error_of_the_frames_that_chose_flatters():
    """Landmarks that are nothing but noise: the choice fits them, frames without a part in it tell the truth."""
    flattered = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        errors = ReprojectionErrors(CANDIDATES, 3, 4)
        for index in range(8):
            errors.add(fold_of_frame(index, 8, 4), rng.normal(size=(N_VERTICES, 2)), rng.normal(size=(3, 2)))
        selection = errors.select()
        flattered.append((selection.held_out_error - selection.error) / selection.error)
    assert np.mean(flattered) > 0.2


def test_the_errors_of_given_vertices_are_those_of_the_definition():
    rng = np.random.default_rng(1)
    frames = [(100 * rng.normal(size=(N_VERTICES, 2)), 100 * rng.normal(size=(3, 2))) for _ in range(6)]
    errors = ReprojectionErrors(CANDIDATES, 3, 2)
    expected = np.zeros(3)
    for index, (projected, annotated) in enumerate(frames):
        errors.add(index % 2, projected, annotated)
        width, height = np.ptp(annotated, axis=0)
        expected += np.linalg.norm(projected[TRUE] - annotated, axis=1) / np.sqrt(width * height) / len(frames)
    np.testing.assert_allclose(errors.of(CANDIDATES[TRUE]), expected)
    assert np.isnan(errors.of(np.array([1, 1, 1]))).all()  # odd numbers are no candidates


def test_vertices_are_chosen_in_pairs_that_mirror_each_other():
    """Annotations lie beside their vertices, all to one side, as a careless annotator's would."""
    rng = np.random.default_rng(0)
    x = np.array([-3.0, -2, -1, 0, 0, 1, 2, 3])  # the mirror image of each vertex but 3 and 4 is at 7 - i
    vertices = np.column_stack([x, rng.normal(size=4)[[0, 1, 2, 3, 3, 2, 1, 0]] + [0, 0, 0, 0, 1, 0, 0, 0]])
    mirror = MirrorImages(landmarks=(2, 1, 0), vertices=np.array([7, 6, 5, 3, 4, 2, 1, 0]))
    aside = vertices[[1, 3, 6]] + [0.7, 0]
    chosen = []
    for pairs in (None, mirror):
        errors = ReprojectionErrors(np.arange(8), 3, 2, pairs)
        for fold in (0, 1):
            errors.add(fold, vertices, aside)
        chosen.append(errors.select())
    alone, paired = chosen
    assert alone.vertices[2] == 7
    np.testing.assert_array_equal(paired.vertices, [1, 3, 6])
    np.testing.assert_allclose(paired.error, alone.error.max())
    np.testing.assert_allclose(paired.held_out_error, paired.error)


def test_missing_landmarks_do_not_count():
    errors = ReprojectionErrors(CANDIDATES, 3, 2)
    projected = np.random.default_rng(0).normal(size=(N_VERTICES, 2))
    for index in range(4):
        annotated = projected[TRUE].copy()
        if index == 0:
            annotated[1] = np.nan
        errors.add(index % 2, projected, annotated)
    selection = errors.select()
    np.testing.assert_array_equal(selection.n_frames, [4, 3, 4])
    np.testing.assert_array_equal(selection.vertices, CANDIDATES[TRUE])


def test_a_landmark_seen_in_one_fold_only_cannot_be_checked():
    errors = ReprojectionErrors(CANDIDATES, 3, 2)
    projected = np.random.default_rng(0).normal(size=(N_VERTICES, 2))
    for index in range(4):
        annotated = projected[TRUE].copy()
        if index % 2:
            annotated[2] = np.nan
        errors.add(index % 2, projected, annotated)
    with pytest.raises(UsageError, match="landmark 2"):
        errors.select()


def test_bad_frames_are_refused():
    errors = ReprojectionErrors(CANDIDATES, 3, 2)
    with pytest.raises(DegenerateGeometryError, match="two different points"):
        errors.add(0, np.zeros((N_VERTICES, 2)), np.full((3, 2), np.nan))
    with pytest.raises(DegenerateGeometryError, match="in one line"):
        errors.add(0, np.zeros((N_VERTICES, 2)), np.array([[1.0, 1], [2, 1], [3, 1]]))
    with pytest.raises(DegenerateGeometryError, match="finite"):
        errors.add(0, np.full((N_VERTICES, 2), np.inf), np.eye(3)[:, :2])
    with pytest.raises(UsageError, match="--folds"):
        ReprojectionErrors(CANDIDATES, 3, 1)


def test_folds_are_runs_of_equal_length():
    folds = [fold_of_frame(index, 103, 5) for index in range(103)]
    assert folds == sorted(folds)
    assert set(np.bincount(folds)) <= {20, 21}
