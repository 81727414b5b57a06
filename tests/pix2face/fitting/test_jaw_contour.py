"""Jaw points that slide: the curves of a model, and what they do to the pose of turned heads."""

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.face_files.annotations import find_annotations
from pix2face.face_files.w300lp import read_coefficient_file
from pix2face.fitting.from_landmarks import LandmarkModel, fit_landmarks
from pix2face.fitting.jaw_contour import JAW, JawContour
from pix2face.geometry.camera import Camera, head_pose
from pix2face.geometry.landmarks import IBUG68_2D, MIRROR_IBUG68
from pix2face.models.morphable_model import MorphableModel, builtin_model
from tests.cameras import posed_camera

YAWS_DEG = (-60.0, -45.0, -30.0, 30.0, 45.0, 60.0)
INNER_ONLY = np.where(np.arange(68) < 17, 0.0, 1.0)


@lru_cache(maxsize=1)
def builtin() -> tuple[MorphableModel, LandmarkModel, JawContour]:
    model = builtin_model()
    return model, LandmarkModel.marked(model), JawContour.of(model)


def camera_at(yaw_deg: float, roll_deg: float = 0) -> Camera:
    return posed_camera(200, 210, yaw_deg=yaw_deg, roll_deg=roll_deg, scale=1.5)


def outline_annotation(camera: Camera, coefficients: ndarray) -> ndarray:
    """68 landmarks as a person annotates them: jaw points where rays from the base of the nose leave the face.

    Independent of the curves: of all face vertices in the right direction of the *picture* the one farthest out.
    """
    model, landmark_model, _ = builtin()
    k = model.n_identity
    vertices = model.vertices(coefficients[None, :k], coefficients[None, k:])[0].astype(np.float64)
    landmarks = camera.project(landmark_model.landmarks3d(coefficients))
    ears = np.isin(
        np.arange(len(vertices)), model.triangles[model.triangle_regions == model.region_names.index("ears")]
    )
    pixels = camera.project(vertices[model.is_face_vertex & ~ears & (vertices[:, 2] > 15)])
    origin = landmarks[33]
    angles = np.arctan2(*(pixels - origin).T)
    for jaw in JAW:
        wanted = np.arctan2(*(landmarks[jaw] - origin))
        difference = np.abs((angles - wanted + np.pi) % (2 * np.pi) - np.pi)
        inside = pixels[difference < 0.03]
        outermost = inside[np.argmax(np.linalg.norm(inside - origin, axis=1))]
        if np.linalg.norm(outermost - origin) > np.linalg.norm(landmarks[jaw] - origin) + 3:
            landmarks[jaw] = outermost
    return landmarks


def test_every_curve_begins_at_its_landmark_and_runs_inward() -> None:
    model, _, contour = builtin()
    landmarks = model.mean[model.landmarks[IBUG68_2D]]
    for jaw in JAW:
        curve = contour.mean[contour.owner == jaw]
        assert np.linalg.norm(curve - landmarks[jaw], axis=1).min() == 0
        assert len(curve) >= 8
        distances = np.linalg.norm((curve - landmarks[33])[:, :2], axis=1)
        assert distances.max() <= np.linalg.norm((landmarks[jaw] - landmarks[33])[:2]) + 3


@pytest.mark.parametrize("roll_deg", [0, 40, 180])
def test_a_frontal_face_keeps_its_landmarks(roll_deg: float) -> None:
    model, _, contour = builtin()
    chosen = contour.outermost(camera_at(0, roll_deg), np.zeros(len(contour.basis)))
    np.testing.assert_array_equal(contour.mean[chosen], model.mean[model.landmarks[IBUG68_2D][:17]])


@pytest.mark.parametrize("yaw_deg", YAWS_DEG)
def test_only_the_far_side_of_a_turned_head_slides(yaw_deg: float) -> None:
    model, _, contour = builtin()
    chosen = contour.outermost(camera_at(yaw_deg), np.zeros(len(contour.basis)))
    way = np.linalg.norm(contour.mean[chosen] - model.mean[model.landmarks[IBUG68_2D][:17]], axis=1)
    far, near = (way[:5], way[10:]) if yaw_deg > 0 else (way[12:], way[:7])  # positive yaw shows the subject's left
    assert far.min() > 5
    assert near.max() < 2


def test_mirrored_heads_slide_alike() -> None:
    _, _, contour = builtin()
    left, right = (
        contour.mean[contour.outermost(camera_at(yaw), np.zeros(len(contour.basis)))] for yaw in (-45.0, 45.0)
    )
    mirrored = right[list(MIRROR_IBUG68[:17])] * [-1, 1, 1]
    assert np.linalg.norm(left - mirrored, axis=1).mean() < 1.5


def test_sliding_finds_the_yaw_that_fixed_jaw_points_hide() -> None:
    _, landmark_model, contour = builtin()
    errors = {"fixed": [], "sliding": []}
    rng = np.random.default_rng(0)
    for yaw_deg in YAWS_DEG:
        coefficients = 0.7 * rng.normal(size=len(landmark_model.basis)).clip(-2, 2)
        annotated = outline_annotation(camera_at(yaw_deg), coefficients)
        for name, used in (("fixed", None), ("sliding", contour)):
            fit = fit_landmarks(landmark_model, annotated, robust=True, contour=used)
            errors[name].append(abs(head_pose(fit.camera).yaw_deg - yaw_deg))
    assert np.mean(errors["sliding"]) < 0.7 * np.mean(errors["fixed"])
    assert np.mean(errors["sliding"]) < 5


def test_the_pose_of_a_file_of_300wlp_is_found_from_its_outline(shared_dir: Path) -> None:
    file = read_coefficient_file(shared_dir / "data" / "300wlp" / "IBUG_image_008_1_0.mat")
    assert file.landmarks2d is not None
    _, landmark_model, contour = builtin()
    fixed = fit_landmarks(landmark_model, file.landmarks2d, robust=True)
    sliding = fit_landmarks(landmark_model, file.landmarks2d, robust=True, contour=contour)
    true = file.pose.head.yaw_deg
    assert abs(head_pose(sliding.camera).yaw_deg - true) < 3
    assert abs(head_pose(fixed.camera).yaw_deg - true) > 6


def test_on_photographs_sliding_agrees_with_the_pose_of_the_inner_points(shared_dir: Path) -> None:
    """The 51 inner points alone tell the yaw, if less surely: sliding jaw points disagree with them less than fixed."""
    _, landmark_model, contour = builtin()
    disagreements = []
    for folder in ("300w", "dlib_faces"):
        for annotation in find_annotations(shared_dir / "data" / folder)[::2]:
            try:
                points = annotation.load().landmarks2d
            except InputFileError:
                continue
            inner_yaw = head_pose(fit_landmarks(landmark_model, points, weights=INNER_ONLY).camera).yaw_deg
            if abs(inner_yaw) > 15:
                fits = (fit_landmarks(landmark_model, points, robust=True, contour=used) for used in (None, contour))
                disagreements.append([abs(head_pose(fit.camera).yaw_deg - inner_yaw) for fit in fits])
    fixed, sliding = np.mean(disagreements, axis=0)
    assert len(disagreements) > 10
    assert sliding < 0.7 * fixed
