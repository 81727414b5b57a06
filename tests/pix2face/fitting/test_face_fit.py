"""The closed loop: known face -> maps in fixed point -> camera, coefficients, landmarks."""

from dataclasses import replace

import numpy as np
import pytest

from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.fitting.face_fit import ERROR_OF_FIT, MEAN_OF_SCALE, fit_face
from pix2face.fitting.fit_options import EXACT_MAPS_REGULARISATION, PREDICTED_MAPS_REGULARISATION
from pix2face.fitting.prepared_model import evenly_spread
from pix2face.geometry.camera import HeadPose, head_pose, pinhole_of
from pix2face.geometry.crops import FaceBox, square_crop
from pix2face.geometry.maps import FaceMaps, PredictedLandmarks
from tests.fits import paper_fit
from tests.pix2face.fitting.rendered_faces import render_known_face
from tests.synthetic_models import small_head_model

POSES = [HeadPose(0, 0, 0), HeadPose(-15, 35, 20), HeadPose(10, -65, -10), HeadPose(5, 90, 5)]


@pytest.fixture(scope="module")
def model():
    return small_head_model()


@pytest.fixture(scope="module")
def frontal(model):
    return render_known_face(model, HeadPose(3, -8, 4), 11, perspective=False)


@pytest.mark.parametrize("kind", ["affine", "weak-perspective", "pinhole"])
@pytest.mark.parametrize("index", range(len(POSES)))
def test_closed_loop(model, index, kind):
    face = render_known_face(model, POSES[index], index, perspective=kind == "pinhole")
    fit = fit_face(
        face.maps,
        model,
        paper_fit(camera=kind, regularisation=EXACT_MAPS_REGULARISATION),
        principal_point_px=face.principal_point_px,
    )
    tolerance = 1e-3 * face.eye_distance_px(model)  # 0.1 % of the eye distance
    landmarks2d = face.landmarks2d(model)
    assert np.linalg.norm(fit.landmarks2d - landmarks2d, axis=1).max() < tolerance
    true_landmarks = face.vertices[model.landmarks["ibug68"]]
    assert np.linalg.norm(fit.camera.project(true_landmarks) - landmarks2d, axis=1).max() < 0.1 * tolerance
    np.testing.assert_allclose(fit.identity, face.identity, atol=0.05)
    np.testing.assert_allclose(fit.expression, face.expression, atol=0.05)
    np.testing.assert_allclose(fit.landmarks2d, fit.camera.project(fit.landmarks3d))


def test_pinhole_gives_the_focal_length_back(model):
    face = render_known_face(model, HeadPose(0, 25, 0), 5, perspective=True)
    fit = fit_face(
        face.maps, model, paper_fit(camera="pinhole", regularisation=1e-3), principal_point_px=face.principal_point_px
    )
    assert pinhole_of(fit.camera).focal_px == pytest.approx(pinhole_of(face.camera).focal_px, rel=1e-3)


def test_every_camera_survives_outliers(model):
    face = render_known_face(model, HeadPose(0, 60, 0), 6, perspective=False)
    rng = np.random.default_rng(0)
    wrong = (rng.uniform(size=face.maps.mask.shape) < 0.15) & face.maps.mask
    values = model.mean[np.flatnonzero(model.is_face_vertex)]
    pncc = face.maps.pncc.copy()
    pncc[wrong] = values[rng.integers(len(values), size=wrong.sum())]
    maps = replace(face.maps, pncc=pncc)
    yaws = {
        kind: head_pose(fit_face(maps, model, paper_fit(camera=kind, regularisation=1.0)).camera).yaw_deg
        for kind in ("affine", "weak-perspective", "pinhole", "auto")
    }
    for yaw in yaws.values():
        assert abs(yaw - 60) < 0.5


def test_predicted_regularisation_serves_smooth_noise(model):
    """Errors of 1.5 mm that are alike over patches, as a network makes them: weaker and stronger penalties do worse."""
    errors = {factor: [] for factor in (1e-4, 1.0, 1e4)}
    for seed in range(4):
        face = render_known_face(model, HeadPose(0, 30, 0), 20 + seed, perspective=False)
        rng = np.random.default_rng(seed)
        noise = np.kron(rng.normal(size=(9, 9, 3)) * 3, np.ones((32, 32, 1)))[:256, :256].astype(np.float32)
        maps = replace(face.maps, offset=(face.maps.offset + noise) * face.maps.mask[..., None])
        for factor in errors:
            fit = fit_face(maps, model, paper_fit(regularisation=factor * PREDICTED_MAPS_REGULARISATION))
            errors[factor].append(np.linalg.norm(fit.vertices - face.vertices, axis=1).mean())
    assert np.mean(errors[1.0]) <= np.mean(errors[1e-4])
    assert np.mean(errors[1.0]) < np.mean(errors[1e4])


def test_in_image_moves_everything(model, frontal):
    fit = fit_face(frontal.maps, model, paper_fit(regularisation=1e-3))
    crop = square_crop(FaceBox(300, 200, 420, 360), 1.4, 256, rotation=0.3)
    moved = fit.in_image(crop)
    np.testing.assert_allclose(moved.landmarks2d, crop.to_image(fit.landmarks2d))
    np.testing.assert_allclose(moved.camera.project(moved.landmarks3d), moved.landmarks2d, atol=1e-8)
    np.testing.assert_array_equal(moved.identity, fit.identity)


def test_errors_that_the_network_expects_go_with_the_landmarks(model, frontal):
    assert fit_face(frontal.maps, model).landmark_errors_px is None
    scales_px = np.linspace(0.5, 3, 68)
    predicted = PredictedLandmarks(np.zeros((68, 2)), scales_px)
    fit = fit_face(replace(frontal.maps, landmarks=predicted), model)
    assert fit.landmark_errors_px == pytest.approx(ERROR_OF_FIT * MEAN_OF_SCALE * scales_px)
    crop = square_crop(FaceBox(300, 200, 420, 360), 1.4, 256, rotation=0.3)
    moved = fit.in_image(crop)
    px_per_px = np.linalg.norm(np.diff(crop.to_image(np.array([[0.0, 0.0], [1.0, 0.0]])), axis=0))
    assert moved.landmark_errors_px == pytest.approx(px_per_px * fit.landmark_errors_px)
    upright = square_crop(FaceBox(300, 200, 420, 360), 1.4, 256)  # boxes of turned landmarks have another size
    assert fit.in_image(upright).expected_error == pytest.approx(fit.expected_error)
    of_five = PredictedLandmarks(np.zeros((5, 2)), np.ones(5))
    assert fit_face(replace(frontal.maps, landmarks=of_five), model).landmark_errors_px is None


def test_bad_maps_have_a_name(model, frontal):
    empty = FaceMaps(frontal.maps.pncc * 0, frontal.maps.offset * 0, np.zeros((256, 256), dtype=bool))
    with pytest.raises(DegenerateGeometryError, match="only background"):
        fit_face(empty, model, paper_fit(regularisation=1.0))
    few = np.zeros((256, 256), dtype=bool)
    few[128, 100:120] = True
    with pytest.raises(DegenerateGeometryError, match="at least 50 valid pixels in the maps, found 20"):
        fit_face(replace(frontal.maps, mask=few), model, paper_fit(regularisation=1.0))
    for name in ("pncc", "offset"):
        broken = getattr(frontal.maps, name).copy()
        broken[128, 128] = np.nan
        with pytest.raises(DegenerateGeometryError, match=r"found 1 of \d+ valid pixels not finite"):
            fit_face(replace(frontal.maps, **{name: broken}), model, paper_fit(regularisation=1.0))


def test_constant_maps_have_a_name(model, frontal):
    constant = np.full_like(frontal.maps.pncc, 60)
    for kind in ("affine", "weak-perspective", "pinhole"):
        with pytest.raises(DegenerateGeometryError):
            fit_face(
                replace(frontal.maps, pncc=constant, offset=constant), model, paper_fit(camera=kind, regularisation=1.0)
            )


@pytest.mark.parametrize("wrong", [{"regularisation": -5.0}, {"reprojection_rounds": -1}])
def test_options_that_no_fit_can_use_are_refused(model, frontal, wrong):
    with pytest.raises(UsageError, match="found -"):
        fit_face(frontal.maps, model, paper_fit(**wrong))


def test_a_type_of_landmarks_that_does_not_exist_is_refused():
    options = paper_fit(regularisation=1.0)
    object.__setattr__(options, "landmark_type", "4d")  # as without the type checks of the tests
    with pytest.raises(UsageError, match="expected --landmark-type of auto, 3d, 2d, found '4d'"):
        options.check()


def test_a_fit_is_shown_in_one_line(model, frontal):
    fit = fit_face(frontal.maps, model, paper_fit(regularisation=1.0))
    assert repr(fit) == f"<FaceFit to {model.name!r}: 68 landmarks, no box, expected error unknown>"
    assert repr(model).startswith(f"<MorphableModel {model.name!r}: {len(model.mean)} vertices")


def test_unknown_landmarks_are_refused(model, frontal):
    with pytest.raises(UsageError, match=r"'menpo84'.*found \['ibug68'\]"):
        fit_face(frontal.maps, model, paper_fit(regularisation=1.0), scheme="menpo84")


def test_evenly_spread():
    np.testing.assert_array_equal(evenly_spread(3, 10), [0, 1, 2])
    assert len(evenly_spread(10_000, 2000)) == 2000
    assert evenly_spread(10_000, 2000)[[0, -1]].tolist() == [0, 9999]
    assert len(evenly_spread(0, 5)) == 0
