"""From the maps of one picture to camera, coefficients, mesh and landmarks."""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import final

import numpy as np
from jaxtyping import Float, Float32, Float64
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.fitting.fit_options import DEFAULT_FIT, FitOptions, LandmarkType
from pix2face.fitting.jaw_contour import JAW, JawContour
from pix2face.fitting.picture_measurement import Constraints, measure_picture
from pix2face.fitting.prepared_model import vertex_basis
from pix2face.geometry.camera import Camera
from pix2face.geometry.crops import Crop, FaceBox
from pix2face.geometry.landmarks import IBUG68, IBUG68_2D
from pix2face.geometry.maps import FaceMaps, PredictedLandmarks
from pix2face.models.morphable_model import MorphableModel

# Mean distance in the plane if distances fall off like exp(-r / b), in units of b.
MEAN_OF_SCALE = 2.0
# Error of fitted landmarks in units of that of the landmarks that the network predicts itself, over the photographs of
# aflw2000-3d-dev (docs/explanation/fitting.md).
ERROR_OF_FIT = 0.94
# Angle between the estimated and the true head for each per cent of the expected error, likewise.
DEGREES_PER_PERCENT = 1.87


@final
@dataclass(frozen=True, eq=False)
class FaceFit:
    """A face found in a picture; pixels are those of the maps, or of the image after ``in_image``.

    Attributes:
        camera: From the model frame to the picture.
        identity: Coefficients in standard deviations.
        expression: Coefficients in standard deviations.
        model: The model of the coefficients.
        landmarks2d: Projections of the landmark vertices, seen or hidden, pixels (x, y), centres at +0.5.
        landmarks3d: The landmark vertices, mm, model frame.
        box: Box in which the network looked for the face, pixels; None for a fit to maps of unknown origin.
        score: The score that the detector gave the face; None if the box was given.
        landmark_errors_px: Expected distance of each landmark from its true place, pixels; None if the network does not
            predict it.
    """

    camera: Camera
    identity: Float64[ndarray, " k"]
    expression: Float64[ndarray, " e"]
    model: MorphableModel
    landmarks2d: Float64[ndarray, "m 2"]
    landmarks3d: Float64[ndarray, "m 3"]
    box: FaceBox | None = None
    score: float | None = None
    landmark_errors_px: Float64[ndarray, " m"] | None = None

    def __repr__(self) -> str:
        """The face in one line, without its arrays."""
        box = "no box" if self.box is None else "box " + ", ".join(f"{side:.0f}" for side in self.box.sides)
        error = "unknown" if self.expected_error is None else f"{100 * self.expected_error:.1f} %"
        return f"<FaceFit to {self.model.name!r}: {len(self.landmarks2d)} landmarks, {box}, expected error {error}>"

    @cached_property
    def vertices(self) -> Float32[ndarray, "v 3"]:
        """The vertices of the mesh, mm, model frame. They are computed on first access."""
        return self.model.vertices(self.identity[None], self.expression[None])[0]

    def in_image(self, crop: Crop) -> "FaceFit":
        """The fit in the pixels of the image that the maps' crop was taken from."""
        return self.transformed(crop.image_from_crop)

    def transformed(self, matrix: Float[ndarray, "3 3"]) -> "FaceFit":
        """The fit in a picture whose pixels (x, y, 1) are those of this one times a similarity."""
        landmarks2d = self.landmarks2d @ matrix[:2, :2].T + matrix[:2, 2]
        errors_px = self.landmark_errors_px
        if errors_px is not None:
            errors_px = errors_px * np.sqrt(abs(np.linalg.det(matrix[:2, :2])))
        camera = self.camera.transformed(matrix)
        return replace(self, camera=camera, landmarks2d=landmarks2d, landmark_errors_px=errors_px)

    def with_errors_of(self, predicted: PredictedLandmarks | None) -> "FaceFit":
        """The fit with the errors that a network expects of its landmarks, if it predicts as many."""
        if predicted is None or len(predicted.scales_px) != len(self.landmarks2d):
            return self
        return replace(self, landmark_errors_px=expected_distances(predicted))

    @property
    def expected_error(self) -> float | None:
        """Mean of the expected errors of the landmarks, in units of sqrt(w h) of their box; None if unknown.

        It is an estimate of ``nme`` with the normaliser "box-sqrt".
        """
        return None if self.landmark_errors_px is None else expected_error(self.landmarks2d, self.landmark_errors_px)

    @property
    def expected_rotation_deg(self) -> float | None:
        """Expected angle between the estimated and the true head, degrees; None if unknown.

        It is proportional to ``expected_error``: heads are turned wrongly where landmarks are off.
        """
        return None if self.expected_error is None else 100 * DEGREES_PER_PERCENT * self.expected_error


def fit_face(
    maps: FaceMaps,
    model: MorphableModel,
    options: FitOptions = DEFAULT_FIT,
    *,
    principal_point_px: Float[ndarray, "2"] | None = None,
    scheme: str = IBUG68,
    n_vertices: int | None = None,
    constraints: Constraints = "vertices",
) -> FaceFit:
    """Fits camera and coefficients to the maps of one picture.

    Args:
        maps: PNCC, offset and mask. If the maps say which part of the mask is visible, the camera is fitted to that
            part.
        model: The morphable model of the maps.
        options: Camera, regularisation and so on. The defaults are for predicted maps. Exact maps are fitted best
            without the silhouette and with ``EXACT_MAPS_REGULARISATION``. All cameras are robust against outliers;
            "auto" decides by ``camera_choice``.
        principal_point_px: Where the optical axis of a pinhole meets the maps. None uses the centre of the maps, which
            is wrong if the crop is not at the centre of the image.
        scheme: Scheme of the model's landmarks.
        n_vertices: Number of vertices of the face to look for, evenly spread (docs/explanation/fitting.md compares time
            and error). None means 1,000 if lambda is that of predicted maps (0.5 mm^2 or more), otherwise 2,500.
        constraints: "vertices" as in the paper, or "surface": pixels inside the triangles of the mean face. On exact
            maps, surface constraints are ten times as accurate and ten times as slow. In noisy maps, hardly any pixel
            lies on the surface. They cannot be combined with the silhouette.

    Raises:
        DegenerateGeometryError: Fewer than 50 valid pixels, values that are not finite, or none of the vertices found.
        UsageError: The model has no such landmarks, or there is no such kind of camera.

    Source: Crispell and Bazik 2017, Sections 3.4 and 4.
    """
    check_scheme(model, scheme)
    measured = measure_picture(
        maps, model, options, principal_point_px=principal_point_px, n_vertices=n_vertices, constraints=constraints
    )
    identity, expression = np.split(measured.coefficients, [model.n_identity])
    face = face_of_coefficients(
        model, measured.camera, identity, expression, scheme=scheme, landmark_type=options.landmark_type
    )
    return face.with_errors_of(maps.landmarks)


def face_of_coefficients(
    model: MorphableModel,
    camera: Camera,
    identity: Float64[ndarray, " k"],
    expression: Float64[ndarray, " e"],
    *,
    scheme: str = IBUG68,
    landmark_type: LandmarkType = "auto",
) -> FaceFit:
    """Puts a face together from its camera and coefficients (standard deviations).

    The type "2d" changes the landmarks in the picture alone: they are those of the scheme ``ibug68-2d``, if the model
    has it, and the jaw lies on the visible outline.

    Raises:
        UsageError: The model has no such landmarks, or they have no jaw to move.
    """
    check_scheme(model, scheme)
    mean, basis = _landmark_basis(model, scheme)
    coefficients = np.concatenate([identity, expression])
    landmarks3d = np.asarray(mean + basis @ coefficients, dtype=np.float64)
    landmarks2d = camera.project(landmarks3d)
    if landmark_type == "2d":
        if scheme != IBUG68:
            raise UsageError(f"landmark type 2d: expected the landmarks {IBUG68}, found {scheme!r}")
        if IBUG68_2D in model.landmarks:
            mean, basis = _landmark_basis(model, IBUG68_2D)
            landmarks2d = camera.project(mean + basis @ coefficients)
        landmarks2d[list(JAW)] = camera.project(_contour_of(model).outermost_points(camera, coefficients))
    return FaceFit(camera, identity, expression, model, landmarks2d, landmarks3d)


def expected_distances(predicted: PredictedLandmarks) -> Float64[ndarray, " n"]:
    """Expected distances of fitted landmarks from their true places, pixels of the maps."""
    return ERROR_OF_FIT * MEAN_OF_SCALE * predicted.scales_px


def expected_error(landmarks2d: Float64[ndarray, "n 2"], distances_px: Float64[ndarray, " n"]) -> float:
    """Mean of expected distances in units of sqrt(w h) of the box of the landmarks."""
    return float(distances_px.mean() / np.sqrt(np.prod(np.ptp(landmarks2d, axis=0))))


def check_scheme(model: MorphableModel, scheme: str) -> None:
    """Refuses landmarks that a model does not have.

    Raises:
        UsageError: See above.
    """
    if scheme not in model.landmarks:
        raise UsageError(f"expected landmarks {scheme!r} in the model {model.name!r}, found {sorted(model.landmarks)}")


@lru_cache(maxsize=4)
def _landmark_basis(model: MorphableModel, scheme: str) -> tuple[Float64[ndarray, "m 3"], Float64[ndarray, "m 3 c"]]:
    vertices = model.landmarks[scheme]
    return model.mean_landmarks(scheme), vertex_basis(model, vertices).astype(np.float64)


@lru_cache(maxsize=2)
def _contour_of(model: MorphableModel) -> JawContour:
    return JawContour.of(model)
