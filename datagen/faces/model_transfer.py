"""Converts the coefficients of one model to those of another, by their meshes or by their landmarks.

Both ways compare points of the two mean faces. These points are linear in the coefficients of the source, and the
least-squares coefficients of the target are linear in the points. So the transfer is an affine map.
"""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Float, Float32, Float64, Int
from numpy import ndarray
from scipy.spatial import KDTree

from datagen.datagen_config import Through
from pix2face.errors import ModelMismatchError, UsageError
from pix2face.face_files.coefficients import FaceCoefficients, configuration_to_json
from pix2face.fitting.from_landmarks import LANDMARK_REGULARISATION
from pix2face.geometry.landmarks import IBUG68
from pix2face.geometry.rigid_alignment import RigidTransform, fit_rigid
from pix2face.models.morphable_model import MorphableModel

# Points of the aligned mean faces that are farther apart than this do not match: one of the surfaces ends there.
LARGEST_DISTANCE_MM = 10.0
LEAST_PAIRS = 100
# Variance in mm^2 for each vertex; neighbouring vertices move together, so it is much less than for landmarks.
DENSE_REGULARISATION = 0.001
# The closest point of a surface is searched on this number of triangles with the nearest centres.
CANDIDATES = 12
# Residuals are measured on this number of faces.
MEASURED_FACES = 200


@final
@dataclass(frozen=True)
class TransferResidual:
    """How far the faces of the target are from those of the source."""

    through: str  # what was compared: `dense` or `landmarks`
    n_points: int  # compared points in each face
    alignment_mm: float  # mean distance between the points of the aligned mean faces
    mean_mm: float  # mean distance between the points of source and target, over points and faces
    percentile_95_mm: float  # 95 % of these distances are smaller
    rms: float  # RMS of the target's coefficients in standard deviations


@final
@dataclass(frozen=True, eq=False)
class ModelTransfer:
    """An affine map between the coefficients (identity before expression) of two models, and the compared points."""

    target_from_source: RigidTransform  # between the frames of the models
    matrix: Float64[ndarray, "t s"]  # maps source coefficients to target coefficients
    offset: Float64[ndarray, " t"]  # target coefficients of the source's mean face
    source_points: Float64[ndarray, "p 3"]  # compared points of the source's mean face in the target's frame, mm
    source_basis: Float64[ndarray, "s p 3"]  # their displacement by each coefficient, mm
    target_points: Float64[ndarray, "p 3"]  # the same of the target
    target_basis: Float64[ndarray, "t p 3"]

    def coefficients(self, source: Float[ndarray, "n s"]) -> Float64[ndarray, "n t"]:
        """Target coefficients of source coefficients."""
        return np.asarray(source @ self.matrix.T + self.offset, dtype=np.float64)

    def distances_mm(self, source: Float[ndarray, "n s"]) -> Float64[ndarray, "n p"]:
        """Distances between the points of the source's faces and of the transferred ones."""
        distances = []
        for given, found in zip(source, self.coefficients(source), strict=True):
            wanted = self.source_points + np.tensordot(given, self.source_basis, axes=1)
            moved = self.target_points + np.tensordot(found, self.target_basis, axes=1)
            distances.append(np.linalg.norm(moved - wanted, axis=1))
        return np.stack(distances)


def find_transfer(source: MorphableModel, target: MorphableModel, through: Through) -> ModelTransfer:
    """Computes the affine map from the coefficients of one model to those of another.

    ``dense`` compares all face vertices of the target with the nearest points of the source's surface, and
    ``landmarks`` the 68 landmarks.

    Raises:
        UsageError: A model lacks the landmarks, or the surfaces are too far apart.
    """
    for model in (source, target):
        if IBUG68 not in model.landmarks:
            raise UsageError(f"{model.name}: expected {IBUG68} landmarks (they align the models), found none")
    source_landmarks, target_landmarks = source.landmarks[IBUG68], target.landmarks[IBUG68]
    aligned, _ = fit_rigid(
        source.mean[source_landmarks].astype(np.float64), target.mean[target_landmarks].astype(np.float64)
    )
    if through == "landmarks":
        corners, weights = np.repeat(source_landmarks[:, None], 3, axis=1), np.tile([1.0, 0, 0], (68, 1))
        return _solve(source, target, aligned, (target_landmarks, corners, weights), LANDMARK_REGULARISATION)
    vertices, corners, weights = _closest_points(source, target, aligned)
    if len(vertices) < LEAST_PAIRS:
        raise UsageError(
            f"expected the surfaces of {source.name} and {target.name} to meet, found {len(vertices)} vertices within "
            f"{LARGEST_DISTANCE_MM:.0f} mm of each other; try --through landmarks"
        )
    return _solve(source, target, aligned, (vertices, corners, weights), DENSE_REGULARISATION * len(vertices))


def transfer_table(
    table: FaceCoefficients, source: MorphableModel, target: MorphableModel, through: Through
) -> tuple[FaceCoefficients, TransferResidual]:
    """Converts all faces of a table; cameras are converted by the alignment of the models' frames.

    Raises:
        ModelMismatchError: The table does not belong to ``source``.
        UsageError: As in ``find_transfer``.
    """
    if table.model_sha256 != source.sha256:
        raise ModelMismatchError(
            f"the coefficients belong to model {table.model_name} ({table.model_sha256[:12]}), found model "
            f"{source.name} ({source.sha256[:12]}); give the former with --from-model"
        )
    transfer = find_transfer(source, target, through)
    given = np.concatenate([table.identity, table.expression], axis=1)
    found = transfer.coefficients(given).astype(np.float32)
    cameras = table.cameras @ np.linalg.inv(transfer.target_from_source.matrix)
    k = target.n_identity
    earlier = {"from": table.model_name, "from_sha256": table.model_sha256, "through": through}
    transferred = replace(
        table,
        model_name=target.name,
        model_sha256=target.sha256,
        identity=found[:, :k].copy(),
        expression=found[:, k:].copy(),
        cameras=cameras,
        configuration=configuration_to_json({**earlier, "table": table.configuration}),
        licence=f"{table.licence or source.licence}; model: {target.licence}",
    )
    return transferred, _residual(transfer, given, found, through)


def _residual(
    transfer: ModelTransfer, given: ndarray, found: Float32[ndarray, "n t"], through: str
) -> TransferResidual:
    step = max(1, -(-len(given) // MEASURED_FACES))
    distances = transfer.distances_mm(given[::step].astype(np.float64))
    apart = np.linalg.norm(transfer.source_points - transfer.target_points, axis=1)
    return TransferResidual(
        through=through,
        n_points=len(apart),
        alignment_mm=float(apart.mean()),
        mean_mm=float(distances.mean()),
        percentile_95_mm=float(np.percentile(distances, 95)),
        rms=float(np.sqrt((found.astype(np.float64) ** 2).mean())),
    )


def _solve(
    source: MorphableModel,
    target: MorphableModel,
    aligned: RigidTransform,
    pairs: tuple[Int[ndarray, " p"], Int[ndarray, "p 3"], Float64[ndarray, "p 3"]],
    regularisation: float,
) -> ModelTransfer:
    """Minimises |target - source|^2 + regularisation |c|^2 for all source faces at once."""
    vertices, corners, weights = pairs

    def at_points(values: Float32[ndarray, "v 3"]) -> Float64[ndarray, "p 3"]:
        return np.asarray((values[corners] * weights[..., None]).sum(axis=1, dtype=np.float64))

    source_points = aligned.apply(at_points(source.mean))
    components = [*source.identity_basis, *source.expression_basis]
    source_basis = aligned.turn(np.stack([at_points(component) for component in components]))
    target_points = target.mean[vertices].astype(np.float64)
    target_basis = np.concatenate([target.identity_basis[:, vertices], target.expression_basis[:, vertices]])
    target_basis = target_basis.astype(np.float64)
    rows = target_basis.reshape(len(target_basis), -1)
    normal = rows @ rows.T + regularisation * np.eye(len(rows))
    right = np.column_stack(
        [rows @ source_basis.reshape(len(source_basis), -1).T, rows @ (source_points - target_points).reshape(-1)]
    )
    solved = np.linalg.solve(normal, right)
    return ModelTransfer(
        aligned, solved[:, :-1], solved[:, -1], source_points, source_basis, target_points, target_basis
    )


def _closest_points(
    source: MorphableModel, target: MorphableModel, aligned: RigidTransform
) -> tuple[Int[ndarray, " p"], Int[ndarray, "p 3"], Float64[ndarray, "p 3"]]:
    """The closest points of the source's mean to face vertices of the target's: corners and barycentric weights."""
    import trimesh  # half a second, which commands that need no triangles save

    vertices = np.flatnonzero(target.is_face_vertex)
    points = target.mean[vertices].astype(np.float64)
    triangles = source.triangles[source.is_face_triangle]
    corners = aligned.apply(source.mean.astype(np.float64))[triangles]
    near = KDTree(corners.mean(axis=1)).query(points, k=min(CANDIDATES, len(triangles)))[1]
    repeated = np.repeat(points, near.shape[1], axis=0)
    found = trimesh.triangles.closest_point(corners[near.ravel()], repeated)  # type: ignore[no-untyped-call]
    found = found.reshape(*near.shape, 3)
    distances = np.linalg.norm(found - points[:, None], axis=2)
    best = distances.argmin(axis=1)
    rows = np.arange(len(points))
    kept = distances[rows, best] <= LARGEST_DISTANCE_MM
    chosen = near[rows, best][kept]
    weights = trimesh.triangles.points_to_barycentric(  # type: ignore[no-untyped-call]
        corners[chosen], found[rows, best][kept]
    )
    return vertices[kept], triangles[chosen], np.nan_to_num(np.asarray(weights, dtype=np.float64))
