"""From the maps of one picture to camera, coefficients, mesh and landmarks."""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal, final

import numpy as np
from jaxtyping import Float, Float32, Float64
from numpy import ndarray

from pix2face.camera import Camera
from pix2face.crops import Crop
from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.face_maps import FaceMaps
from pix2face.fitting.camera_choice import fit_warranted_camera
from pix2face.fitting.camera_fit import fit_affine_camera, fit_weak_perspective_camera
from pix2face.fitting.linear_system import ImageSystem, image_system
from pix2face.fitting.localise import ValidPixels, localise_prepared, valid_pixel_values
from pix2face.fitting.pinhole_fit import fit_pinhole_camera
from pix2face.fitting.prepared_model import evenly_spread, prepared_model, vertex_basis
from pix2face.landmarks import IBUG68
from pix2face.morphable_model import MorphableModel

CameraKind = Literal["affine", "weak-perspective", "pinhole", "auto"]

# Section 3.4.1: "only a small subset of the correspondences" is needed for the camera. Of vertices, as many tell some
# hundred coefficients as well as all of them do, at a fraction of the time.
CAMERA_PIXELS = 2000
# The distance hangs on small differences: it takes more.
PERSPECTIVE_PIXELS = 8000
COEFFICIENT_VERTICES = 2500
_CORRESPONDENCES = {"pinhole": PERSPECTIVE_PIXELS, "auto": PERSPECTIVE_PIXELS}

# Sums over some thousand vertices in single precision are off by 1e-3 mm^2: far below lambda from here on.
SINGLE_PRECISION_FROM = 0.5

# Fewer valid pixels are noise at the edge of a picture without a face.
LEAST_PIXELS = 50


@final
@dataclass(frozen=True, eq=False)
class FaceFit:
    """A face found in a picture; pixels are those of the maps, or of the image after ``in_image``.

    Attributes:
        camera: From the model frame to the picture.
        identity: Coefficients in standard deviations.
        expression: Coefficients in standard deviations.
        model: What the coefficients are of.
        landmarks2d: Projections of the landmark vertices, seen or hidden, pixels (x, y), centres at +0.5.
        landmarks3d: The landmark vertices, mm, model frame.
    """

    camera: Camera
    identity: Float64[ndarray, " k"]
    expression: Float64[ndarray, " e"]
    model: MorphableModel
    landmarks2d: Float64[ndarray, "m 2"]
    landmarks3d: Float64[ndarray, "m 3"]

    @cached_property
    def vertices(self) -> Float32[ndarray, "v 3"]:
        """The mesh of these coefficients, mm, model frame: computed when asked for."""
        return self.model.vertices(self.identity[None], self.expression[None])[0]

    def in_image(self, crop: Crop) -> "FaceFit":
        """The fit in the pixels of the image that the maps' crop was taken from."""
        camera = self.camera.transformed(crop.image_from_crop)
        return replace(self, camera=camera, landmarks2d=crop.to_image(self.landmarks2d))


def fit_face(
    maps: FaceMaps,
    model: MorphableModel,
    *,
    camera_kind: CameraKind = "weak-perspective",
    regularisation: float,
    principal_point_px: Float[ndarray, "2"] | None = None,
    scheme: str = IBUG68,
) -> FaceFit:
    """Fits camera and coefficients to the maps of one picture.

    Args:
        maps: PNCC, offset and mask.
        model: The model that the maps are of.
        camera_kind: "affine" (Eq. 1), "weak-perspective" (the default: predicted maps of profiles tilt and stretch an
            unconstrained affine camera), "pinhole", or "auto": a pinhole where ``camera_choice`` finds it warranted,
            else weak perspective. All are robust against outliers.
        regularisation: Tikhonov's lambda in mm^2; see ``coefficient_fit``.
        principal_point_px: Pinhole and auto: where the optical axis meets the maps, None is their centre. It is not the
            centre where the maps are those of a crop off the image's centre.
        scheme: Which landmarks of the model.

    Raises:
        DegenerateGeometryError: Fewer than 50 valid pixels, values that are not finite, or none of the vertices found.
        UsageError: The model has no such landmarks, or there is no such kind of camera.

    Source: Crispell and Bazik 2017, Sections 3.4 and 4.
    """
    check_scheme(model, scheme)
    camera, system = fit_camera_and_system(
        maps, model, camera_kind=camera_kind, regularisation=regularisation, principal_point_px=principal_point_px
    )
    coefficients = system.solve(regularisation)
    identity, expression = coefficients[: model.n_identity], coefficients[model.n_identity :]
    return face_of_coefficients(model, camera, identity, expression, scheme)


def fit_camera_and_system(
    maps: FaceMaps,
    model: MorphableModel,
    *,
    camera_kind: CameraKind,
    regularisation: float,
    principal_point_px: Float[ndarray, "2"] | None,
) -> tuple[Camera, ImageSystem]:
    """What one picture says: its camera, and the linear system of its coefficients (arguments as ``fit_face``).

    Raises:
        DegenerateGeometryError: As ``fit_face``.
        UsageError: There is no such kind of camera.
    """
    pixels = valid_pixel_values(maps)
    points3d, points2d = correspondences(pixels, maps.mask.shape[1], _CORRESPONDENCES.get(camera_kind, CAMERA_PIXELS))
    if principal_point_px is None:
        principal_point_px = np.array([maps.mask.shape[1], maps.mask.shape[0]]) / 2
    prepared = prepared_model(model, COEFFICIENT_VERTICES)
    face_width_mm = float(np.ptp(prepared.mean[:, 0]))
    camera = fit_camera(points3d, points2d, camera_kind, principal_point_px, face_width_mm)
    found = localise_prepared(maps, pixels, prepared)
    basis = prepared.basis[found.places]
    if regularisation < SINGLE_PRECISION_FROM:
        basis = basis.astype(np.float64)
    return camera, image_system(basis, found.offsets, regularisation, robust=True)


def face_of_coefficients(
    model: MorphableModel,
    camera: Camera,
    identity: Float64[ndarray, " k"],
    expression: Float64[ndarray, " e"],
    scheme: str = IBUG68,
) -> FaceFit:
    """Puts a face together from its camera and coefficients.

    Raises:
        UsageError: The model has no such landmarks.
    """
    check_scheme(model, scheme)
    mean, basis = _landmark_basis(model, scheme)
    landmarks3d = np.asarray(mean + basis @ np.concatenate([identity, expression]), dtype=np.float64)
    return FaceFit(camera, identity, expression, model, camera.project(landmarks3d), landmarks3d)


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
    return model.mean[vertices].astype(np.float64), vertex_basis(model, vertices).astype(np.float64)


def correspondences(
    pixels: ValidPixels, width: int, at_most: int
) -> tuple[Float64[ndarray, "n 3"], Float64[ndarray, "n 2"]]:
    """Points of the face (x_i = PNCC + offset, mm) and the centres of their pixels, evenly spread over the valid ones.

    Raises:
        DegenerateGeometryError: Fewer than 50 valid pixels.
    """
    if len(pixels.places) < LEAST_PIXELS:
        raise DegenerateGeometryError(
            f"expected at least {LEAST_PIXELS} valid pixels in the maps, found {len(pixels.places)}: "
            "no face is in the crop"
        )
    kept = evenly_spread(len(pixels.places), at_most)
    rows, columns = np.divmod(pixels.places[kept], width)
    points3d = pixels.pncc[kept].astype(np.float64) + pixels.offset[kept]
    return points3d, np.column_stack([columns, rows]) + 0.5


def fit_camera(
    points3d: Float[ndarray, "n 3"],
    points2d: Float[ndarray, "n 2"],
    camera_kind: CameraKind,
    principal_point_px: Float[ndarray, "2"],
    face_width_mm: float,
) -> Camera:
    """Fits the chosen kind of camera.

    Raises:
        DegenerateGeometryError: The points do not determine it.
        UsageError: There is no such kind.
    """
    if camera_kind == "affine":
        return fit_affine_camera(points3d, points2d, robust=True)
    if camera_kind == "weak-perspective":
        return fit_weak_perspective_camera(points3d, points2d, robust=True)
    if camera_kind == "pinhole":
        initial = fit_affine_camera(points3d, points2d, robust=True)
        return fit_pinhole_camera(points3d, points2d, principal_point_px, initial, robust=True)
    if camera_kind == "auto":
        return fit_warranted_camera(points3d, points2d, principal_point_px, face_width_mm)
    raise UsageError(f"expected a camera of affine, weak-perspective, pinhole or auto, found {camera_kind!r}")
