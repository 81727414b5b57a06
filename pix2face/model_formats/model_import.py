"""Brings a published model to the project's frame: unit, rigid transform, landmarks; never a scale.

Where a model has landmarks, they are laid onto those of the built-in model. Where it has none, or not all 68, they come
by correspondence: the built-in head is laid onto the model's surface, adapted to it by its own identity components, and
its landmarks are looked up there. Such landmarks are marked approximate.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Bool, Float64, Int64
from numpy import ndarray
from scipy.spatial import KDTree

from pix2face.errors import InputFileError
from pix2face.geometry.landmarks import IBUG68, INNER51, N_IBUG68
from pix2face.geometry.rigid_alignment import (
    RigidTransform,
    Surface,
    SurfaceIndex,
    align_surfaces,
    fit_rigid,
    surface_of,
    trimmed_rms,
)
from pix2face.model_formats import read_model
from pix2face.model_formats.checks import turned_round, wound_outward
from pix2face.models.model_file import Alignment, StoredModel
from pix2face.models.morphable_model import builtin_model

LEAST_LANDMARKS = 6
# Beyond this two surfaces are not both faces, or one stands on its head: published means, the right way up, lie 2 to
# 3 mm from the built-in one, and more than 5 mm where the search went wrong.
PLAUSIBLE_RESIDUAL_MM = 4.5
# Landmarks are points that people chose, farther apart than surfaces.
PLAUSIBLE_LANDMARKS_MM = 12.0
# The frame of this family is the project's.
PROJECT_FRAME_PREFIX = "bfm2009"

# Where the middle of a model may lie in the project's frame: of a mask, of a head, of heads with more and more neck.
MIDDLES_MM = np.array([[0.0, 3, 66], [0, 20, 15], [0, -30, 10], [0, -80, 0]])

_ADAPTATION_STEPS = 12
_ADAPTATION_POINTS = 3000
# Variance (mm^2) of a surface point that identity components should not follow.
_ADAPTATION_NOISE = 4.0
_ADAPTATION_SHARE = 0.9
# A part of a model farther than this from the built-in head is something that the built-in head lacks.
_SAME_PART_MM = 12.0
_OTHER_REGION = "other"


@final
@dataclass(frozen=True, eq=False)
class ImportedModel:
    """The result of an import, with remarks for the user."""

    model: StoredModel  # in the project's frame, or in the published one where no face was found in it
    notes: tuple[str, ...]


def import_model(path: Path) -> ImportedModel:
    """Reads a published model and brings it to the project's frame.

    Raises:
        InputFileError: As ``read_model``; or there are landmarks, and they do not fit those of a head.
    """
    stored = read_model(path)
    landmarks = stored.landmarks.get(IBUG68, np.full(N_IBUG68, -1, np.int32))
    known = np.flatnonzero(landmarks >= 0)
    # Not the jaw's: each model puts them somewhere else along the jaw.
    if (known >= INNER51[0]).sum() >= LEAST_LANDMARKS:
        return _by_landmarks(path, stored, known)
    return lay_by_surface(replace(stored, landmarks={}))


def laid_by(stored: StoredModel, frame_from_file: RigidTransform) -> StoredModel:
    """The model moved and turned; its triangles wound outward there."""
    mean = frame_from_file.apply(stored.mean).astype(np.float32)
    polygons = wound_outward(mean, stored.polygons)
    is_turned = not np.array_equal(polygons, stored.polygons)
    uv_polygons = stored.uv_polygons
    if is_turned and uv_polygons is not None:
        uv_polygons = turned_round(uv_polygons)
    return replace(
        stored,
        mean=mean,
        identity_basis=frame_from_file.turn(stored.identity_basis).astype(np.float32),
        expression_basis=frame_from_file.turn(stored.expression_basis).astype(np.float32),
        polygons=polygons,
        uv_polygons=uv_polygons,
    )


def _by_landmarks(path: Path, stored: StoredModel, known: Int64[ndarray, " n"]) -> ImportedModel:
    inner = known[known >= INNER51[0]]
    target = _builtin_landmarks()[inner]
    source = stored.mean[stored.landmarks[IBUG68][inner]].astype(np.float64)
    transform, scale = fit_rigid(source, target)
    keeps_frame = stored.published_basis.startswith(PROJECT_FRAME_PREFIX)
    if keeps_frame:
        transform = RigidTransform(np.eye(3), np.zeros(3))
    residual = float(np.sqrt(((transform.apply(source) - target) ** 2).sum(axis=1).mean()))
    if residual > PLAUSIBLE_LANDMARKS_MM:
        raise InputFileError(
            f"{path}: expected {len(inner)} landmarks within {PLAUSIBLE_LANDMARKS_MM:g} mm of those of a head, "
            f"found {residual:.1f} mm (a similarity would scale by {scale:.4g}): the unit or the landmarks are wrong"
        )
    laid = stored if keeps_frame else laid_by(stored, transform)
    laid = replace(
        laid, alignment=Alignment(frame_from_file=transform.matrix, residual_mm=residual, landmark_scale=scale)
    )
    notes = [
        f"{len(known)} published landmarks; the {len(inner)} inside the face lie {residual:.1f} mm (RMS) from those of "
        f"the built-in model, a similarity would have scaled by {scale:.3f} (not applied)"
        + ("; the frame is the project's as published" if keeps_frame else "")
    ]
    if len(known) < N_IBUG68:
        adapted = _adapted_builtin(surface_of(laid.mean, laid.polygons))
        laid = _with_missing_landmarks(laid, adapted)
        notes.append(f"{N_IBUG68 - len(known)} of {N_IBUG68} landmarks come by correspondence: approximate")
    return ImportedModel(laid, tuple(notes))


def lay_by_surface(stored: StoredModel) -> ImportedModel:
    """Brings a model without landmarks to the project's frame by its surface alone.

    Landmarks and regions come by correspondence. Where no face is found in the model it stays as it was, with a note.
    """
    file_from_frame, distances = align_surfaces(
        _builtin_surface().chosen(_builtin_face()), surface_of(stored.mean, stored.polygons), MIDDLES_MM
    )
    residual = trimmed_rms(distances)
    if residual > PLAUSIBLE_RESIDUAL_MM or len(stored.mean) < 2 * N_IBUG68:
        return ImportedModel(
            stored,
            (
                f"no face was found in it ({len(stored.mean)} vertices; the built-in face lies {residual:.1f} mm from "
                "it at best): imported as published, without landmarks; what needs landmarks will refuse it",
            ),
        )
    rotation = file_from_frame.rotation.T
    transform = RigidTransform(rotation, -rotation @ file_from_frame.translation)
    laid = laid_by(stored, transform)
    adapted = _adapted_builtin(surface_of(laid.mean, laid.polygons))
    laid = _with_missing_landmarks(_with_builtin_regions(laid, adapted), adapted)
    scale = fit_rigid(laid.mean[laid.landmarks[IBUG68]], _builtin_landmarks())[1]
    alignment = Alignment(frame_from_file=transform.matrix, residual_mm=residual, landmark_scale=scale)
    note = (
        f"no published landmarks: laid onto the built-in head by its surface, {residual:.1f} mm (RMS); a similarity "
        f"would have scaled by {scale:.3f} (not applied); all {N_IBUG68} landmarks and the regions are approximate"
    )
    return ImportedModel(replace(laid, alignment=alignment), (note,))


def _builtin_landmarks() -> Float64[ndarray, "68 3"]:
    builtin = builtin_model()
    return builtin.mean[builtin.landmarks[IBUG68]].astype(np.float64)


def _builtin_surface(coefficients: Float64[ndarray, " k"] | None = None) -> Surface:
    builtin = builtin_model()
    head = builtin.mean.astype(np.float64)
    if coefficients is not None:
        head = head + np.tensordot(coefficients, builtin.identity_basis.astype(np.float64), axes=1)
    none = np.full((len(builtin.triangles), 1), -1, dtype=np.int32)
    return surface_of(head, np.hstack([builtin.triangles, none]))


def _builtin_face() -> Int64[ndarray, " n"]:
    """Vertices of the built-in head that every face model has: ears are missing in masks."""
    builtin = builtin_model()
    is_ear = builtin.triangle_regions == builtin.region_names.index("ears")
    return np.unique(builtin.triangles[builtin.is_face_triangle & ~is_ear]).astype(np.int64)


def _adapted_builtin(surface: Surface) -> Surface:
    """The built-in head after its identity components followed a surface, by closest points in the face."""
    builtin, index = builtin_model(), SurfaceIndex(surface)
    face = _builtin_face()
    face = face[np.random.default_rng(0).permutation(len(face))[:_ADAPTATION_POINTS]]
    mean = builtin.mean[face].astype(np.float64)
    basis = builtin.identity_basis[:, face].astype(np.float64)
    normals = _builtin_surface().normals[face]
    coefficients = np.zeros(len(basis))
    transform = RigidTransform(np.eye(3), np.zeros(3))
    for _ in range(_ADAPTATION_STEPS):
        shape = Surface(mean + np.tensordot(coefficients, basis, axes=1), normals)
        distances, partners = index.closest(shape.moved(transform))
        kept = distances <= np.quantile(distances, _ADAPTATION_SHARE)
        target = surface.points[partners]
        transform, _ = fit_rigid(shape.points[kept], target[kept])
        wanted = (target - transform.translation) @ transform.rotation - mean
        columns = basis[:, kept].reshape(len(basis), -1)
        normal_matrix = columns @ columns.T + _ADAPTATION_NOISE * np.eye(len(basis))
        coefficients = np.linalg.solve(normal_matrix, columns @ wanted[kept].ravel())
    return _builtin_surface(coefficients).moved(transform)


def _with_missing_landmarks(laid: StoredModel, adapted: Surface) -> StoredModel:
    """Fills the landmarks that a model lacks with the vertices nearest to those of the adapted built-in head."""
    places = adapted.chosen(builtin_model().landmarks[IBUG68])
    nearest = SurfaceIndex(surface_of(laid.mean, laid.polygons)).closest(places)[1].astype(np.int32)
    published = laid.landmarks.get(IBUG68, np.full(N_IBUG68, -1, np.int32))
    missing = published < 0
    landmarks = np.where(missing, nearest, published).astype(np.int32)
    return replace(
        laid,
        landmarks={**laid.landmarks, IBUG68: landmarks},
        approximate_landmarks=np.flatnonzero(missing).astype(np.int32),
    )


def _with_builtin_regions(laid: StoredModel, adapted: Surface) -> StoredModel:
    """Regions of the nearest part of the built-in head, for a model that tells none apart; far parts are "other"."""
    builtin = builtin_model()
    centres = adapted.points[builtin.triangles].mean(axis=1)
    distances, nearest = KDTree(centres).query(_polygon_centres(laid))
    regions = builtin.triangle_regions[nearest]
    regions[distances > _SAME_PART_MM] = len(builtin.region_names)
    return replace(
        laid,
        polygon_regions=regions,
        region_names=(*builtin.region_names, _OTHER_REGION),
        face_regions=builtin.face_regions,
    )


def _polygon_centres(stored: StoredModel) -> Float64[ndarray, "p 3"]:
    is_corner: Bool[ndarray, "p 4"] = stored.polygons >= 0
    corners = stored.mean[stored.polygons].astype(np.float64) * is_corner[..., None]
    return np.asarray(corners.sum(axis=1) / is_corner.sum(axis=1)[:, None])
