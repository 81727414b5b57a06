"""What the maps of one picture say: a camera, and the linear system of the coefficients."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, final

import numpy as np
from jaxtyping import Float, Float64, Int
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.fitting.cameras.camera_choice import fit_warranted_camera
from pix2face.fitting.cameras.camera_fit import fit_affine_camera, fit_weak_perspective_camera
from pix2face.fitting.cameras.pinhole_fit import fit_pinhole_camera
from pix2face.fitting.cameras.reprojection import with_reprojection
from pix2face.fitting.fit_options import FitOptions
from pix2face.fitting.least_squares.linear_system import PREDICTED_MAPS_ROUNDS, ROBUST_ROUNDS, ImageSystem, image_system
from pix2face.fitting.localise import ValidPixels, VertexPixels, localise_prepared, valid_pixel_values
from pix2face.fitting.noise import FIRST_REGULARISATION, estimated_regularisation, without_white_noise
from pix2face.fitting.prepared_model import PreparedModel, evenly_spread, prepared_model
from pix2face.fitting.silhouette import FaceSurface, OutsideDistance, fit_camera_to_silhouette, with_silhouette
from pix2face.geometry.camera import Camera
from pix2face.geometry.maps import FaceMaps, FitCorrector
from pix2face.models.morphable_model import MorphableModel

Constraints = Literal["vertices", "surface"]
# From this lambda (mm^2) on maps are a network's, whose errors are alike over patches; below they may be exact to
# 0.01 mm.
IS_OF_PREDICTED_MAPS_FROM = 0.5

# Section 3.4.1: "only a small subset of the correspondences" is needed for the camera. Of vertices, as many tell some
# hundred coefficients as well as all of them do, at a fraction of the time.
CAMERA_PIXELS = 2000
# The distance hangs on small differences: it takes more.
PERSPECTIVE_PIXELS = 8000
COEFFICIENT_VERTICES = 2500
# Errors of a network are alike over patches: fewer vertices tell as much of its maps (docs/explanation/fitting.md).
PREDICTED_MAPS_VERTICES = 1000
_CORRESPONDENCES = {"pinhole": PERSPECTIVE_PIXELS, "auto": PERSPECTIVE_PIXELS}

# Pixels of the surface that are looked at, and the variance of their rounding to 1/128 mm, twice: of both maps.
SURFACE_PIXELS = 4000
EXACT_SURFACE_REGULARISATION = 1e-5

# Where less than this of the mask is seen, what is hidden counts as well.
LEAST_SEEN_SHARE = 0.3
# Numbers of pixels, and of vertices of the whole face, for the camera that is held to the silhouette.
SILHOUETTE_PIXELS = SILHOUETTE_VERTICES = 400

# Fewer valid pixels are noise at the edge of a picture without a face.
LEAST_PIXELS = 50


@final
@dataclass(frozen=True, eq=False)
class PictureMeasurement:
    """What one picture says of a face."""

    camera: Camera  # from the model frame to the pixels of the maps
    system: ImageSystem  # the normal equations of the coefficients
    regularisation: float  # lambda in mm^2: given, or estimated from the residuals
    coefficients: Float64[ndarray, " c"]  # solution of the system, identity before expression, standard deviations


def measure_picture(
    maps: FaceMaps,
    model: MorphableModel,
    options: FitOptions,
    *,
    principal_point_px: Float[ndarray, "2"] | None = None,
    n_vertices: int | None = None,
    constraints: Constraints = "vertices",
) -> PictureMeasurement:
    """Finds camera and system; the arguments are those of ``fit_face``.

    Raises:
        DegenerateGeometryError: As ``fit_face``.
        UsageError: The options are unusable, or reprojection is asked for without vertices.
    """
    options.check()
    regularisation = None if options.regularisation == "estimate" else options.regularisation
    if constraints == "surface" and options.reprojection_rounds:
        raise UsageError("expected vertices as constraints for reprojection rounds, found pixels of the surface")
    whole, maps = maps, without_white_noise(maps)
    pixels = valid_pixel_values(maps)
    is_predicted = regularisation is not None and regularisation >= IS_OF_PREDICTED_MAPS_FROM
    if n_vertices is None:
        n_vertices = PREDICTED_MAPS_VERTICES if is_predicted else COEFFICIENT_VERTICES
    prepared = prepared_model(model, n_vertices)
    if principal_point_px is None:
        principal_point_px = np.array([maps.mask.shape[1], maps.mask.shape[0]]) / 2
    can_hold = options.is_held and constraints == "vertices"
    fit_camera = partial(
        _fit_camera,
        kind=options.camera,
        principal_point_px=principal_point_px,
        face_width_mm=float(np.ptp(prepared.mean[:, 0])),
    )
    clear, width = _clear_pixels(maps, pixels), maps.mask.shape[1]
    if can_hold and options.camera == "weak-perspective":
        # Only a start: the fit to the silhouette is robust itself.
        camera = fit_affine_camera(*correspondences(pixels, clear, width, SILHOUETTE_PIXELS))
    else:
        n_pixels = _CORRESPONDENCES.get(options.camera, CAMERA_PIXELS)
        camera = fit_camera(*correspondences(pixels, clear, width, n_pixels))
    if constraints == "surface":
        return _on_surface(camera, model, pixels, regularisation)
    found = localise_prepared(maps, pixels, prepared)
    # Sums over some thousand vertices in single precision are off by 1e-3 mm^2: far below lambda of predicted maps.
    precision = np.float32 if is_predicted else np.float64
    basis = prepared.basis.take(found.places, axis=0).astype(precision, copy=False)
    if regularisation is None:
        regularisation = _estimated(basis, found, prepared)
    rounds = PREDICTED_MAPS_ROUNDS if is_predicted else ROBUST_ROUNDS
    system = image_system(basis, found.offsets, regularisation, robust_rounds=rounds)
    measured = PictureMeasurement(camera, system, regularisation, system.solve(regularisation))
    if can_hold and camera.is_affine:
        silhouette = _Silhouette(OutsideDistance.of(whole), *correspondences(pixels, clear, width, SILHOUETTE_PIXELS))
        measured = _inside_mask(measured, silhouette, prepared, found, basis, max(1, options.reprojection_rounds))
        return _corrected(measured, whole.correct) if options.is_corrected and whole.correct else measured
    return _reprojected(measured, fit_camera, prepared.mean[found.places], found, basis, options.reprojection_rounds)


def _clear_pixels(maps: FaceMaps, pixels: ValidPixels) -> Int[ndarray, " m"]:
    """Which of the pixels show the face itself; all where these are too few, or not known."""
    everything = np.arange(len(pixels.places))
    if maps.seen is None:
        return everything
    clear = np.flatnonzero(maps.seen.reshape(-1).take(pixels.places))
    return clear if len(clear) >= max(LEAST_PIXELS, LEAST_SEEN_SHARE * len(everything)) else everything


def _on_surface(
    camera: Camera, model: MorphableModel, pixels: ValidPixels, regularisation: float | None
) -> PictureMeasurement:
    """Sets up and solves the system of pixels inside the triangles of the mean face."""
    from pix2face.fitting.surface_pixels import surface_rows  # loads scipy.spatial

    regularisation = EXACT_SURFACE_REGULARISATION if regularisation is None else regularisation
    rows = surface_rows(model, pixels, SURFACE_PIXELS)
    system = image_system(*rows, regularisation, robust_rounds=ROBUST_ROUNDS)
    return PictureMeasurement(camera, system, regularisation, system.solve(regularisation))


def _reprojected(
    measured: PictureMeasurement,
    fit_camera: Callable[[Float64[ndarray, "n 3"], Float64[ndarray, "n 2"]], Camera],
    mean: Float[ndarray, "n 3"],
    found: VertexPixels,
    basis: Float[ndarray, "n 3 c"],
    rounds: int,
) -> PictureMeasurement:
    """Fits camera and coefficients in turn for some rounds, without the silhouette."""
    system, regularisation = measured.system, measured.regularisation
    for _ in range(rounds):
        vertices = _face_points(mean, basis, measured.coefficients)
        camera = fit_camera(vertices.astype(np.float64), found.points2d)
        system = with_reprojection(camera, mean, basis, found, system)
        measured = PictureMeasurement(camera, system, regularisation, system.solve(regularisation))
    return measured


@final
@dataclass(frozen=True, eq=False)
class _Silhouette:
    """The mask that a face must stay in, and the correspondences that its camera is fitted to."""

    outside: OutsideDistance
    points3d: Float64[ndarray, "n 3"]  # mm
    points2d: Float64[ndarray, "n 2"]  # pixels


def _inside_mask(
    measured: PictureMeasurement,
    silhouette: _Silhouette,
    prepared: PreparedModel,
    found: VertexPixels,
    basis: Float[ndarray, "n 3 c"],
    rounds: int,
) -> PictureMeasurement:
    """Fits the camera with the mesh held to the mask, then coefficients and camera in turn for some rounds."""
    outside, some = silhouette.outside, evenly_spread(len(prepared.mean), SILHOUETTE_VERTICES)
    whole_basis = prepared.basis.astype(basis.dtype, copy=False)

    def face_of(coefficients: Float64[ndarray, " c"]) -> FaceSurface:
        return FaceSurface(_face_points(prepared.mean, whole_basis, coefficients), prepared.mean)

    def camera_of(before: Camera, face: FaceSurface) -> Camera:
        few = FaceSurface(face.vertices[some], face.mean[some])
        return fit_camera_to_silhouette(before, silhouette.points3d, silhouette.points2d, few, outside)

    system, regularisation, coefficients = measured.system, measured.regularisation, measured.coefficients
    face = face_of(coefficients)
    camera = camera_of(measured.camera, face)
    for _ in range(rounds):
        system = with_reprojection(camera, prepared.mean[found.places], basis, found, system)
        system = with_silhouette(camera, face, whole_basis, outside, system)
        coefficients = system.solve(regularisation)
        face = face_of(coefficients)
        camera = camera_of(camera, face)
    return PictureMeasurement(camera, system, regularisation, coefficients)


def _corrected(measured: PictureMeasurement, correct: FitCorrector) -> PictureMeasurement:
    """What the network makes of a fit: another camera, and a system whose solution is the corrected coefficients."""
    camera, coefficients = correct(measured.camera, measured.coefficients)
    system, change = measured.system, coefficients - measured.coefficients
    right = system.right + system.normal @ change + measured.regularisation * change
    return PictureMeasurement(camera, replace(system, right=right), measured.regularisation, coefficients)


def _face_points(
    mean: Float[ndarray, "n 3"], basis: Float[ndarray, "n 3 c"], coefficients: Float64[ndarray, " c"]
) -> Float[ndarray, "n 3"]:
    """Points of a face (mm) in the precision of the basis, from the same points of the mean face."""
    moved = basis.reshape(-1, basis.shape[2]) @ coefficients.astype(basis.dtype)
    return np.asarray(mean + moved.reshape(-1, 3))


def _fit_camera(
    points3d: Float[ndarray, "n 3"],
    points2d: Float[ndarray, "n 2"],
    *,
    kind: str,
    principal_point_px: Float[ndarray, "2"],
    face_width_mm: float,
) -> Camera:
    """Fits a camera of a kind to points, robustly.

    Raises:
        DegenerateGeometryError: The points do not determine it.
        UsageError: There is no such kind.
    """
    if kind == "affine":
        return fit_affine_camera(points3d, points2d, robust=True)
    if kind == "weak-perspective":
        return fit_weak_perspective_camera(points3d, points2d, robust=True)
    if kind == "pinhole":
        initial = fit_affine_camera(points3d, points2d, robust=True)
        return fit_pinhole_camera(points3d, points2d, principal_point_px, initial, robust=True)
    if kind == "auto":
        return fit_warranted_camera(points3d, points2d, principal_point_px, face_width_mm)
    raise UsageError(f"expected a camera of affine, weak-perspective, pinhole or auto, found {kind!r}")


def _estimated(basis: Float[ndarray, "n 3 c"], found: VertexPixels, prepared: PreparedModel) -> float:
    """Estimates lambda from the residuals."""
    first = image_system(basis, found.offsets, FIRST_REGULARISATION, robust_rounds=ROBUST_ROUNDS)
    return estimated_regularisation(first, basis, found.offsets, prepared.patches[found.places])


def correspondences(
    pixels: ValidPixels, usable: Int[ndarray, " m"], width: int, at_most: int
) -> tuple[Float64[ndarray, "n 3"], Float64[ndarray, "n 2"]]:
    """Points of the face (x_i = PNCC + offset, mm) and the centres of their pixels, evenly spread over the usable ones.

    Raises:
        DegenerateGeometryError: Fewer than 50 usable pixels.
    """
    if len(usable) < LEAST_PIXELS:
        raise DegenerateGeometryError(
            f"expected at least {LEAST_PIXELS} valid pixels in the maps, found {len(usable)}: no face is in the crop"
        )
    kept = usable[evenly_spread(len(usable), at_most)]
    rows, columns = np.divmod(pixels.places[kept], width)
    points3d = pixels.pncc[kept].astype(np.float64) + pixels.offset[kept]
    return points3d, np.column_stack([columns, rows]) + 0.5
