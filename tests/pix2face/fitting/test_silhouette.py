"""Camera and mesh held to the mask: what wrong PNCC gets wrong, the silhouette puts right."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy import ndarray

from pix2face.fitting.face_fit import FaceFit, fit_face
from pix2face.fitting.joint_fit import fit_joint
from pix2face.fitting.least_squares.linear_system import image_system
from pix2face.fitting.prepared_model import prepared_model, spread_vertices
from pix2face.fitting.silhouette import SLACK_PX, FaceSurface, OutsideDistance, with_silhouette
from pix2face.geometry.camera import HeadPose, head_pose, nearest_weak_perspective
from pix2face.geometry.maps import FaceMaps
from pix2face.models.morphable_model import builtin_model
from tests.fits import paper_fit
from tests.pix2face.fitting.rendered_faces import SIZE_PX, KnownFace, render_known_face

MODEL = builtin_model()


@pytest.fixture(scope="module")
def turned() -> KnownFace:
    return render_known_face(MODEL, HeadPose(5, 50, -5), 4, perspective=False)


def maps_of(mask: ndarray) -> FaceMaps:
    nothing = np.zeros((*mask.shape, 3), dtype=np.float32)
    return FaceMaps(nothing, nothing, mask)


def landmark_error_px(face: KnownFace, fit: FaceFit) -> float:
    return float(np.linalg.norm(fit.landmarks2d - face.landmarks2d(MODEL), axis=1).mean())


def with_smooth_errors(face: KnownFace, seed: int) -> FaceMaps:
    """The face's maps with errors of PNCC that are alike over patches, as a network's are: 10 mm."""
    noise = np.random.default_rng(seed).normal(size=(SIZE_PX, SIZE_PX, 3))
    smooth = cv2.GaussianBlur(noise, (0, 0), 60.0)
    error = (10 / smooth.std() * smooth).astype(np.float32)
    return replace(face.maps, pncc=np.where(face.maps.mask[..., None], face.maps.pncc + error, np.float32(0)))


def test_distance_beyond_the_mask() -> None:
    mask = np.zeros((40, 60), dtype=bool)
    mask[10:30, 20:40] = True
    outside = OutsideDistance.of(maps_of(mask))
    inside, _ = outside.at(np.array([[20.5, 10.5], [30, 20], [39.5, 29.5]]))
    np.testing.assert_array_equal(inside, 0)
    # Right of the mask, whose last pixel has its centre at 39.5; and far beyond the picture's side.
    points = np.array([[45.0, 20.0], [50.25, 20.0], [30.0, 2.0], [65.0, 20.0]])
    distance, slope = outside.at(points)
    np.testing.assert_allclose(distance, np.array([5.5, 10.75, 8.5, 25.5]) - SLACK_PX, atol=0.02)
    np.testing.assert_allclose(slope, [[1, 0], [1, 0], [0, -1], [1, 0]], atol=0.05)


def test_the_slope_is_that_of_the_distance(turned: KnownFace) -> None:
    outside = OutsideDistance.of(turned.maps)
    points = np.random.default_rng(0).uniform(0, SIZE_PX, (200, 2))
    points = np.floor(points) + 0.5 + np.clip(points - np.floor(points), 0.1, 0.9)  # not where the slope jumps
    slope = outside.at(points)[1]
    for axis in range(2):
        step = 1e-4 * np.eye(2)[axis]
        difference = (outside.at(points + step)[0] - outside.at(points - step)[0]) / 2e-4
        np.testing.assert_allclose(slope[:, axis], difference, atol=1e-6)


def test_a_face_goes_on_beyond_the_border_of_the_picture() -> None:
    mask = np.zeros((40, 40), dtype=bool)
    mask[10:30, 20:] = True
    points = np.array([[45.0, 20.0], [55.0, 20.0], [-5.0, 20.0]])
    distance, _ = OutsideDistance.of(maps_of(mask)).at(points)
    np.testing.assert_allclose(distance, [0, 0, 25.5 - SLACK_PX], atol=0.02)


def test_nor_is_it_held_where_the_photograph_has_ended() -> None:
    """The mask ends where the photograph does, 10 pixels from the border of its crop."""
    mask, shown = np.zeros((2, 40, 40), dtype=bool)
    mask[10:20, 20:30] = shown[:, :30] = True
    maps = replace(maps_of(mask), in_photograph=shown)
    distance, slope = OutsideDistance.of(maps).at(np.array([[35.0, 15.0], [45.0, 15.0], [10.0, 15.0], [35.0, 30.0]]))
    np.testing.assert_allclose(distance, [0, 0, 10.5 - SLACK_PX, 10.5 - SLACK_PX], atol=0.02)
    # Beyond the photograph the way back is towards the face, and not out of the photograph.
    np.testing.assert_allclose(slope[2:], [[-1, 0], [0, 1]], atol=0.05)


def test_an_open_mouth_is_inside() -> None:
    mask = np.zeros((40, 40), dtype=bool)
    mask[5:35, 5:35] = True
    mask[20:30, 15:25] = False
    assert OutsideDistance.of(maps_of(mask)).at(np.array([[20.0, 25.0]]))[0] == 0


def test_places_that_are_no_numbers_break_nothing() -> None:
    distance, _ = OutsideDistance.of(maps_of(np.eye(8, dtype=bool))).at(np.array([[np.nan, np.inf]]))
    assert np.isfinite(distance).all()


def test_what_pncc_gets_wrong_over_patches_the_mask_puts_right(turned: KnownFace) -> None:
    faults = []
    for seed in range(8):
        maps = with_smooth_errors(turned, seed)
        fits = [fit_face(maps, MODEL, paper_fit(regularisation=20.0, silhouette=own)) for own in (False, True)]
        faults.append([[abs(head_pose(own.camera).yaw_deg - 50), landmark_error_px(turned, own)] for own in fits])
    (plain_yaw, plain_px), (held_yaw, held_px) = np.mean(faults, axis=0)
    assert held_yaw < 0.75 * plain_yaw
    assert held_px < 0.85 * plain_px


def test_the_mesh_moves_into_the_mask(turned: KnownFace) -> None:
    """Offsets of a face that is 8 % larger, with the camera of the true one: its outer vertices lie beyond the mask."""
    prepared = prepared_model(MODEL, 1200)
    outside = OutsideDistance.of(turned.maps)
    true = turned.vertices[spread_vertices(MODEL, 1200)] - prepared.mean
    system = image_system(prepared.basis, true + 0.08 * prepared.mean, 1.0, robust_rounds=0)

    def face_of(coefficients: ndarray) -> FaceSurface:
        vertices = prepared.mean + prepared.basis @ coefficients.astype(np.float32)
        return FaceSurface(vertices, prepared.mean)

    def beyond_px(face: FaceSurface) -> float:
        near = face.on_near_side(nearest_weak_perspective(turned.camera).rotation)
        return float(outside.at(turned.camera.project(face.vertices[near].astype(np.float64)))[0].mean())

    large = face_of(system.solve(1.0))
    held = with_silhouette(turned.camera, large, prepared.basis, outside, system)
    assert beyond_px(large) > 0.4
    assert beyond_px(face_of(held.solve(1.0))) < 0.75 * beyond_px(large)


@pytest.mark.parametrize("yaw_deg", [0, 50, 90])
def test_exact_maps_stay_exact(yaw_deg: float) -> None:
    face = render_known_face(MODEL, HeadPose(-5, yaw_deg, 10), 9, perspective=False)
    assert landmark_error_px(face, fit_face(face.maps, MODEL, paper_fit(regularisation=1e-3, silhouette=True))) < 0.3


def test_gross_errors_do_not_pull_the_camera(turned: KnownFace) -> None:
    """A twentieth of the pixels, 40 mm off to one side."""
    rng = np.random.default_rng(0)
    pncc = turned.maps.pncc.copy()
    pncc[turned.maps.mask & (rng.random(turned.maps.mask.shape) < 0.05)] += np.float32(40)
    maps = replace(turned.maps, pncc=pncc)
    assert landmark_error_px(turned, fit_face(maps, MODEL, paper_fit(regularisation=1.0, silhouette=True))) < 1


def test_the_camera_goes_by_what_is_seen(turned: KnownFace) -> None:
    """The lower half is behind something, and the network's guess of it is wrong."""
    columns = np.arange(SIZE_PX)
    hidden = turned.maps.mask & (columns[:, None] > 0.55 * SIZE_PX)
    pncc = turned.maps.pncc.copy()
    pncc[hidden] += np.float32([12, 0, -12])
    unknown = replace(turned.maps, pncc=pncc)
    known = replace(unknown, seen=unknown.mask & ~hidden)
    for silhouette in (False, True):
        errors = [
            landmark_error_px(turned, fit_face(maps, MODEL, paper_fit(regularisation=20.0, silhouette=silhouette)))
            for maps in (unknown, known)
        ]
        assert errors[1] < 0.6 * errors[0], silhouette


def test_too_little_that_is_seen_is_no_better_than_all(turned: KnownFace) -> None:
    seen = np.zeros_like(turned.maps.mask)
    seen[100:110, 100:110] = True
    few = replace(turned.maps, seen=seen & turned.maps.mask)
    fits = [fit_face(maps, MODEL, paper_fit(regularisation=20.0)) for maps in (turned.maps, few)]
    np.testing.assert_array_equal(fits[0].landmarks2d, fits[1].landmarks2d)


@pytest.mark.parametrize("kind", ["affine", "pinhole"])
def test_other_cameras_are_not_changed(turned: KnownFace, kind: str) -> None:
    fits = [
        fit_face(turned.maps, MODEL, paper_fit(camera=kind, regularisation=20.0, silhouette=own))
        for own in (False, True)
    ]
    np.testing.assert_array_equal(fits[0].landmarks2d, fits[1].landmarks2d)


def test_a_choice_of_cameras_is_held_where_it_falls_on_weak_perspective(turned: KnownFace) -> None:
    maps = with_smooth_errors(turned, 0)
    plain, held = (
        fit_face(maps, MODEL, paper_fit(camera="auto", regularisation=20.0, silhouette=own)) for own in (False, True)
    )
    assert held.camera.is_affine
    assert landmark_error_px(turned, held) < 0.95 * landmark_error_px(turned, plain)


def test_a_joint_fit_is_held_as_well(turned: KnownFace) -> None:
    maps = [with_smooth_errors(turned, seed) for seed in range(3)]
    plain, held = (fit_joint(maps, MODEL, paper_fit(regularisation=20.0, silhouette=own)) for own in (False, True))
    assert sum(landmark_error_px(turned, fit) for fit in held) < sum(landmark_error_px(turned, fit) for fit in plain)
