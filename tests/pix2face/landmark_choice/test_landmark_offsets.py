"""Offsets of landmarks from their vertices, fitted to frames that were made with known ones."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float64
from numpy import ndarray

from pix2face.geometry.camera import Camera, HeadPose, Pinhole, pinhole_camera, rotation_of_pose
from pix2face.geometry.landmarks import MIRROR_IBUG68
from pix2face.landmark_choice.landmark_offsets import PRIOR_FRAMES, FittedFrame, LandmarkSelection, select_offsets
from pix2face.landmark_choice.landmark_selection import VertexSelection, fold_of_frame
from tests.cameras import posed_camera
from tests.synthetic_models import small_head_model

MODEL = small_head_model()
VERTICES = MODEL.landmarks["ibug68"]
N_COEFFICIENTS = MODEL.n_identity + MODEL.n_expression
N_FRAMES, N_FOLDS = 200, 4
SHRUNK = 1 / (1 + PRIOR_FRAMES / N_FRAMES)


def chosen_vertices() -> VertexSelection:
    errors = np.zeros(len(VERTICES))
    return VertexSelection(VERTICES, np.tile(VERTICES, (N_FOLDS, 1)), errors, errors, np.full(len(VERTICES), N_FRAMES))


def views(rng: np.random.Generator) -> Camera:
    """Heads of several sizes that are seen from all sides."""
    pitch, roll = rng.uniform(-40, 40, 2)
    scale = float(rng.uniform(0.4, 3))
    return posed_camera(
        100, 120, pitch_deg=float(pitch), yaw_deg=float(rng.uniform(-90, 90)), roll_deg=float(roll), scale=scale
    )


def near_views(rng: np.random.Generator) -> Camera:
    """Pinholes at arm's length."""
    rotation = rotation_of_pose(HeadPose(0, float(rng.uniform(-60, 60)), 0))
    return pinhole_camera(Pinhole(800, np.array([128.0, 128.0]), rotation, np.array([0, 0, 500.0])))


def frames_of(
    offsets_mm: Float64[ndarray, "68 3"], noise_mm: float = 0.0, n_frames: int = N_FRAMES, camera_of=views
) -> list[FittedFrame]:
    rng = np.random.default_rng(0)
    frames = []
    for index in range(n_frames):
        camera, coefficients = camera_of(rng), rng.normal(size=N_COEFFICIENTS)
        identity, expression = np.split(coefficients[None], [MODEL.n_identity], axis=1)
        points = MODEL.vertices(identity, expression)[0, VERTICES].astype(np.float64) + offsets_mm
        annotated = camera.project(points + noise_mm * rng.normal(size=points.shape))
        frames.append(FittedFrame(fold_of_frame(index, n_frames, N_FOLDS), camera, coefficients, annotated))
    return frames


def symmetric_offsets() -> Float64[ndarray, "68 3"]:
    one_side = 3 * np.random.default_rng(1).normal(size=(68, 3))
    return (one_side + one_side[list(MIRROR_IBUG68)] * [-1, 1, 1]) / 2


def share_found(found: LandmarkSelection, true: Float64[ndarray, "68 3"]) -> Float64[ndarray, " n"]:
    """How much of each true offset of more than 1 mm was found."""
    size = np.linalg.norm(true, axis=1)
    return ((found.offsets_mm * true).sum(axis=1) / size**2)[size > 1]


@pytest.mark.parametrize("mirror", [None, MIRROR_IBUG68])
def test_known_offsets_are_found_and_shrunk_a_little(mirror):
    true = symmetric_offsets()
    found = select_offsets(chosen_vertices(), frames_of(true), MODEL, mirror)
    np.testing.assert_allclose(share_found(found, true), SHRUNK, atol=0.06)
    assert np.linalg.norm(found.offsets_mm - true, axis=1).max() < 0.2 * np.linalg.norm(true, axis=1).max()


def test_offsets_are_found_by_pinholes():
    true = symmetric_offsets()
    found = select_offsets(chosen_vertices(), frames_of(true, camera_of=near_views), MODEL, MIRROR_IBUG68)
    shares = share_found(found, true)  # less of what is along the line of sight
    assert shares.min() > 0.7
    assert shares.max() < 1


def test_offsets_reduce_the_error_also_in_frames_that_did_not_choose_them():
    frames = frames_of(symmetric_offsets(), noise_mm=1.0)
    found = select_offsets(chosen_vertices(), frames, MODEL, MIRROR_IBUG68)
    few = select_offsets(chosen_vertices(), frames[::20], MODEL, MIRROR_IBUG68)
    noise_alone = select_offsets(chosen_vertices(), frames_of(np.zeros((68, 3)), noise_mm=1.0), MODEL, MIRROR_IBUG68)
    assert found.error.mean() < found.held_out_error.mean() < 1.1 * noise_alone.error.mean()
    assert few.held_out_error.mean() > found.held_out_error.mean()


def test_noise_has_hardly_any_offsets_and_flatters_the_frames_that_chose():
    found = select_offsets(chosen_vertices(), frames_of(np.zeros((68, 3)), noise_mm=2.0, n_frames=20), MODEL)
    assert np.linalg.norm(found.offsets_mm, axis=1).mean() < 0.6
    assert found.error.mean() < 0.97 * found.held_out_error.mean()


def test_offsets_of_pairs_mirror_each_other():
    aside = np.tile([2.0, 0, 0], (68, 1))
    alone, paired = (
        select_offsets(chosen_vertices(), frames_of(aside), MODEL, mirror).offsets_mm
        for mirror in (None, MIRROR_IBUG68)
    )
    assert alone[:, 0].min() > 1.5
    np.testing.assert_allclose(paired, paired[list(MIRROR_IBUG68)] * [-1, 1, 1], atol=1e-9)
    assert np.abs(paired).max() < 0.2


def test_points_that_are_missing_do_not_count():
    true = symmetric_offsets()
    frames = frames_of(true)
    for index in range(0, N_FRAMES, 2):
        annotated = frames[index].annotated.copy()
        annotated[5] = np.nan
        frames[index] = replace(frames[index], annotated=annotated)
    found = select_offsets(chosen_vertices(), frames, MODEL)
    size = np.linalg.norm(true[5])
    assert found.offsets_mm[5] @ true[5] / size**2 == pytest.approx(1 / (1 + 2 * PRIOR_FRAMES / N_FRAMES), abs=0.06)
    assert np.isfinite(found.error).all()
    assert np.isfinite(found.held_out_error).all()
