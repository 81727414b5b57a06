"""Camera, identity and expression from sparse landmarks: what retargets another model's annotations to ours."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Float64, Int
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.cameras.camera_fit import fit_weak_perspective_camera
from pix2face.fitting.face_fit import check_scheme
from pix2face.fitting.jaw_contour import JAW, JawContour
from pix2face.fitting.least_squares.levenberg_marquardt import LocalQuadratic, minimise, quadratic_of_residuals
from pix2face.fitting.least_squares.similarity import Similarity
from pix2face.geometry.camera import Camera, nearest_weak_perspective
from pix2face.geometry.landmarks import IBUG68, IBUG68_2D
from pix2face.models.morphable_model import MorphableModel

# Variance (mm^2) of a landmark's coordinate that the model should not follow. Chosen with the built-in model on the 400
# development files of AFLW2000-3D (scripts/measure_retarget.py): landmarks that were left out are found ever better
# down to 1 mm^2, but below 1.5 the coefficients of single faces exceed an RMS of 1.5 standard deviations.
LANDMARK_REGULARISATION = 2.0

# Below this relative decrease of the cost, landmarks move by less than a thousandth of the face.
RELATIVE_DECREASE = 1e-5
LEAST_LANDMARKS = 6

# Rounds after the plain fit in which jaw points slide and landmarks gain or lose trust.
FURTHER_ROUNDS = 8
TRUST_HAS_SETTLED = 0.02
# 95 % efficiency under normal noise, which makes distances in the picture Rayleigh's.
CAUCHY_SCALE = 2.385
MEDIAN_OF_RAYLEIGH = 1.1774
# Annotators do not agree to less than this: no landmark loses trust for it.
LEAST_USUAL_MM = 1.0


@final
@dataclass(frozen=True, eq=False)
class LandmarkFit:
    """A face fitted to landmarks."""

    camera: Camera  # weak perspective, from the model frame (mm) to the pixels of the landmarks
    identity: Float64[ndarray, " k"]  # standard deviations
    expression: Float64[ndarray, " e"]  # standard deviations
    landmarks2d: Float64[ndarray, "m 2"]  # all landmarks of the fitted face, used or not, pixels
    # The same with jaw points where they slid to: what the given landmarks were compared with.
    matched2d: Float64[ndarray, "m 2"]
    trust: Float64[ndarray, " m"]  # factor (0 to 1) that a robust fit put on each landmark's weight; 1 in a plain one


@final
@dataclass(frozen=True, eq=False)
class LandmarkModel:
    """A morphable model at its landmarks only: small enough for some thousand fits a minute."""

    mean: Float64[ndarray, "m 3"]  # mm, model frame
    basis: Float64[ndarray, "c m 3"]  # mm per standard deviation, identity before expression
    n_identity: int

    @classmethod
    def of(cls, model: MorphableModel, scheme: str = IBUG68) -> "LandmarkModel":
        """Takes the landmark rows of a model, without the offsets of landmarks from their vertices.

        Raises:
            UsageError: The model has no such landmarks.
        """
        check_scheme(model, scheme)
        vertices = model.landmarks[scheme]
        # `take` returns arrays in C order. Indexing does not, and every product would have to copy the basis.
        basis = np.concatenate([each.take(vertices, axis=1) for each in (model.identity_basis, model.expression_basis)])
        # With the offsets, fits follow points in a wrong order so well that checks no longer tell them from faces.
        return cls(model.mean[vertices].astype(np.float64), basis.astype(np.float64), model.n_identity)

    @classmethod
    def marked(cls, model: MorphableModel) -> "LandmarkModel":
        """Takes the landmarks that people mark in photographs, as far as the model knows them."""
        return cls.of(model, IBUG68_2D if IBUG68_2D in model.landmarks else IBUG68)

    def with_jaw(self, contour: JawContour, chosen: Int[ndarray, "17"]) -> "LandmarkModel":
        """The model with other vertices as its jaw points."""
        mean, basis = self.mean.copy(), self.basis.copy()
        mean[list(JAW)], basis[:, list(JAW)] = contour.mean[chosen], contour.basis[:, chosen]
        return LandmarkModel(mean, basis, self.n_identity)

    def rows(self, chosen: Bool[ndarray, " m"]) -> "LandmarkModel":
        """The model of some of the landmarks."""
        return LandmarkModel(self.mean[chosen], self.basis.compress(chosen, axis=1), self.n_identity)

    def landmarks3d(self, coefficients: Float64[ndarray, " c"]) -> Float64[ndarray, "m 3"]:
        """Landmarks of a face, mm, model frame (identity before expression)."""
        return np.asarray(self.mean + np.tensordot(coefficients, self.basis, axes=1), dtype=np.float64)


@final
@dataclass(frozen=True, eq=False)
class FaceState:
    """What the joint fit moves: the pose (about the landmarks' centre) and the coefficients."""

    similarity: Similarity
    coefficients: Float64[ndarray, " c"]

    def moved(self, step: Float64[ndarray, " p"]) -> "FaceState":
        """The state after an increment (similarity, then coefficients)."""
        moved_coefficients = self.coefficients + step[len(step) - len(self.coefficients) :]
        return FaceState(self.similarity.moved(step), moved_coefficients)


def fit_mean_to_landmarks(
    model: MorphableModel | LandmarkModel,
    landmarks2d: Float[ndarray, "m 2"],
    *,
    weights: Float[ndarray, " m"] | None = None,
    robust: bool = False,
) -> Camera:
    """Fits a weak-perspective camera that brings the mean face's landmarks to given ones.

    Arguments are those of ``fit_landmarks``, but a robust fit has Huber's loss.

    Raises:
        DegenerateGeometryError: Fewer than 6 landmarks, or all at one place.
    """
    landmark_model = _landmark_model(model)
    weights = _weights_of_present(landmarks2d, weights)
    return fit_weak_perspective_camera(
        landmark_model.mean,
        np.nan_to_num(landmarks2d, posinf=0, neginf=0),
        weights=weights,
        robust=robust,
    )


def fit_landmarks(
    model: MorphableModel | LandmarkModel,
    landmarks2d: Float[ndarray, "m 2"],
    *,
    weights: Float[ndarray, " m"] | None = None,
    regularisation: float = LANDMARK_REGULARISATION,
    depths_px: Float[ndarray, " m"] | None = None,
    robust: bool = False,
    contour: JawContour | None = None,
) -> LandmarkFit:
    """Fits weak-perspective camera, identity and expression jointly to landmarks.

    Minimises sum_j w_j |project(x_j(c)) - u_j|^2 / s^2 + lambda |c|^2, where s, the scale of the mean face's fit
    (pixels per mm), makes residuals millimetres: lambda means the same for every image size and yaw.

    Args:
        model: The face; of a MorphableModel the iBUG-68 landmarks. A LandmarkModel made once saves a little each time.
        landmarks2d: Pixels (x, y), centres at +0.5; a landmark that is not finite counts as missing.
        weights: Factor of each squared residual; None is 1, 0 leaves a landmark out.
        regularisation: lambda in mm^2: the variance of what the model should not follow.
        depths_px: Depth of the landmarks in the unit of the pixels, larger farther, up to a constant; None where
            unknown. 300W-LP's third coordinate grows towards the viewer: ``w300lp`` negates it on reading.
        robust: Cauchy's loss instead of squares: landmarks far from what the others say (guessed behind a hand, or
            wrong) lose their weight.
        contour: Lets the 17 jaw points slide along it: for landmarks that people marked in the photograph. The model
            should then be ``LandmarkModel.marked``.

    Raises:
        DegenerateGeometryError: Fewer than 6 landmarks, all at one place, or lambda not positive.
    """
    if not regularisation > 0:
        raise DegenerateGeometryError(f"expected a positive regularisation in mm^2, found {regularisation}")
    landmark_model = _landmark_model(model)
    camera = fit_mean_to_landmarks(landmark_model, landmarks2d, weights=weights, robust=robust)
    targets, given = landmarks2d.astype(np.float64), _weights_of_present(landmarks2d, weights)
    if depths_px is not None:
        targets = np.column_stack([targets, depths_px])
    seen = given > 0
    centre = given[seen] @ landmark_model.mean[seen] / given[seen].sum()
    problem = _Problem(targets[seen], centre, regularisation, camera)
    matched, trust = landmark_model, np.ones(len(landmarks2d))
    state = problem.start(given[seen], len(landmark_model.basis))
    for is_first in (True,) + (False,) * (FURTHER_ROUNDS if robust or contour else 0):
        if not is_first:
            before = matched, trust
            if contour is not None:
                chosen = contour.outermost(state.similarity.camera(problem.centre), state.coefficients)
                matched = landmark_model.with_jaw(contour, chosen)
            if robust:
                trust = np.ones(len(seen))
                trust[seen] = _trust(matched.rows(seen), problem, state)
            if np.array_equal(before[0].mean, matched.mean) and np.abs(before[1] - trust).max() < TRUST_HAS_SETTLED:
                break
        quadratic = problem.quadratic(matched.rows(seen), (given * trust)[seen])
        state, _ = minimise(state, quadratic, FaceState.moved, relative_decrease=RELATIVE_DECREASE)
    camera, c, k = state.similarity.camera(problem.centre), state.coefficients, landmark_model.n_identity
    landmarks2d, matched2d = (camera.project(points.landmarks3d(c)) for points in (landmark_model, matched))
    return LandmarkFit(camera, c[:k], c[k:], landmarks2d, matched2d, trust)


def _landmark_model(model: MorphableModel | LandmarkModel) -> LandmarkModel:
    return model if isinstance(model, LandmarkModel) else LandmarkModel.of(model)


def _weights_of_present(
    landmarks2d: Float[ndarray, "m 2"], weights: Float[ndarray, " m"] | None
) -> Float64[ndarray, " m"]:
    """The weights, 0 where a landmark is missing."""
    present: Bool[ndarray, " m"] = np.isfinite(landmarks2d).all(axis=1)
    out = np.where(present, np.ones(len(landmarks2d)) if weights is None else weights, 0.0)
    if (out > 0).sum() < LEAST_LANDMARKS:
        raise DegenerateGeometryError(
            f"a face needs at least {LEAST_LANDMARKS} landmarks, found {int((out > 0).sum())} "
            f"with finite coordinates and a weight, of {len(out)}"
        )
    return np.asarray(out, dtype=np.float64)


@final
@dataclass(frozen=True, eq=False)
class _Problem:
    """What stays the same while weights and matches change."""

    targets: Float64[ndarray, "m d"]  # the landmarks that are used, pixels; the third coordinate is depth where known
    centre: Float64[ndarray, "3"]  # the model point (mm) that poses turn about
    regularisation: float  # mm^2
    camera: Camera  # fitted to the mean face

    def start(self, weights: Float64[ndarray, " m"], n_coefficients: int) -> FaceState:
        """The mean face in the camera that was fitted to it."""
        pose = nearest_weak_perspective(self.camera)
        depth = weights @ self.targets[:, 2:] / weights.sum()  # empty where depths are unknown
        shift = np.concatenate([self.camera.project(self.centre), depth])
        return FaceState(Similarity(float(np.log(pose.scale)), pose.rotation, shift), np.zeros(n_coefficients))

    def quadratic(self, model: LandmarkModel, weights: Float64[ndarray, " m"]) -> Callable[[FaceState], LocalQuadratic]:
        """The local quadratic of pose and coefficients, in mm^2."""
        targets, weights = self.targets, weights / nearest_weak_perspective(self.camera).scale ** 2

        def local_quadratic(state: FaceState) -> LocalQuadratic:
            points = model.landmarks3d(state.coefficients) - self.centre
            rows = state.similarity.scale * state.similarity.rotation[: targets.shape[1]]
            jacobian = np.concatenate(
                [state.similarity.jacobian(points), np.transpose(model.basis @ rows.T, (1, 2, 0))], axis=2
            )
            data = quadratic_of_residuals(state.similarity.apply(points) - targets, jacobian, weights)
            c, n_pose = state.coefficients, jacobian.shape[2] - len(state.coefficients)
            data.hessian[np.arange(n_pose, jacobian.shape[2]), np.arange(n_pose, jacobian.shape[2])] += (
                self.regularisation
            )
            gradient = data.gradient + self.regularisation * np.concatenate([np.zeros(n_pose), c])
            return LocalQuadratic(data.cost + self.regularisation * float(c @ c) / 2, gradient, data.hessian)

        return local_quadratic


def _trust(model: LandmarkModel, problem: _Problem, state: FaceState) -> Float64[ndarray, " m"]:
    """Cauchy's weights of the landmarks' distances, in units of what is usual in this face; 1 for the better half.

    The better half keeps its full weight, so that the prior means the same as in a plain fit.
    """
    found = state.similarity.apply(model.landmarks3d(state.coefficients) - problem.centre)
    distances_mm = np.linalg.norm(found - problem.targets, axis=1) / state.similarity.scale
    median_mm = float(np.median(distances_mm))
    usual_mm = CAUCHY_SCALE * max(median_mm / MEDIAN_OF_RAYLEIGH, LEAST_USUAL_MM)
    weights = (1 + (median_mm / usual_mm) ** 2) / (1 + (distances_mm / usual_mm) ** 2)
    return np.minimum(weights, 1.0)
