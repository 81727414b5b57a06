"""From the coefficients of one model to those of another, by their meshes or by their landmarks.

Both ways compare points of the two mean faces. What a source face does to these points is linear in its coefficients,
and the target's least-squares answer is linear in the points: so the transfer is one affine map, and a table is
transferred by one matrix product.
"""

from dataclasses import dataclass, replace
from typing import Literal, final

import numpy as np
from jaxtyping import Float, Float32, Float64, Int
from numpy import ndarray
from scipy.spatial import KDTree

from pix2face.errors import ModelMismatchError, UsageError
from pix2face.face_files.coefficients import FaceCoefficients, configuration_to_json
from pix2face.fitting.from_landmarks import LANDMARK_REGULARISATION
from pix2face.geometry.landmarks import IBUG68
from pix2face.geometry.rigid_alignment import RigidTransform, fit_rigid
from pix2face.models.morphable_model import MorphableModel

Through = Literal["dense", "landmarks"]

# Points of the aligned mean faces farther apart than this are not the same place: one of the two ends here.
LARGEST_DISTANCE_MM = 10.0
LEAST_PAIRS = 100
# Variance (mm^2 a vertex) that the target should not follow: neighbouring vertices move together, so much less than
# for landmarks.
DENSE_REGULARISATION = 0.001
# Triangles near a point that may hold its closest point.
CANDIDATES = 12
# Faces whose residuals are looked at.
MEASURED_FACES = 200


@final
@dataclass(frozen=True)
class TransferResidual:
    """What the target could not follow.

    Attributes:
        through: The way that was taken.
        n_points: Points compared in each face.
        alignment_mm: Mean distance of the aligned mean faces' points.
        mean_mm: Mean distance between the source's points and the target's, over points and faces.
        percentile_95_mm: 95 % of the distances are below.
        rms: Of the target's coefficients, standard deviations.
    """

    through: str
    n_points: int
    alignment_mm: float
    mean_mm: float
    percentile_95_mm: float
    rms: float


@final
@dataclass(frozen=True, eq=False)
class ModelTransfer:
    """An affine map between the coefficients (identity before expression) of two models, and what it rests on.

    Attributes:
        target_from_source: Between the models' frames.
        matrix: Target coefficients from source coefficients.
        offset: Target coefficients of the source's mean face.
        source_points: The compared points of the source's mean, in the target's frame, mm.
        source_basis: What each source coefficient does to them.
        target_points: The compared points of the target's mean, mm.
        target_basis: What each target coefficient does to them.
    """

    target_from_source: RigidTransform
    matrix: Float64[ndarray, "t s"]
    offset: Float64[ndarray, " t"]
    source_points: Float64[ndarray, "p 3"]
    source_basis: Float64[ndarray, "s p 3"]
    target_points: Float64[ndarray, "p 3"]
    target_basis: Float64[ndarray, "t p 3"]

    def coefficients(self, source: Float[ndarray, "n s"]) -> Float64[ndarray, "n t"]:
        """Target coefficients of source coefficients."""
        return np.asarray(source @ self.matrix.T + self.offset, dtype=np.float64)

    def distances_mm(self, source: Float[ndarray, "n s"]) -> Float64[ndarray, "n p"]:
        """How far the transferred faces' points are from the source's."""
        return np.stack([np.linalg.norm(self._difference(row), axis=1) for row in source])

    def _difference(self, source: Float[ndarray, " s"]) -> Float64[ndarray, "p 3"]:
        wanted = self.source_points + np.tensordot(source, self.source_basis, axes=1)
        target = source @ self.matrix.T + self.offset
        return np.asarray(self.target_points + np.tensordot(target, self.target_basis, axes=1) - wanted)


def find_transfer(source: MorphableModel, target: MorphableModel, through: Through) -> ModelTransfer:
    """Prepares the way from one model to another.

    Args:
        source: Whose coefficients are given.
        target: Whose coefficients are wanted.
        through: ``dense`` compares all face vertices of the target with the nearest points of the source's surface;
            ``landmarks`` the 68 landmarks.

    Raises:
        UsageError: A model lacks the landmarks, or the surfaces do not meet.
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
    """Transfers all faces of a table. Cameras are carried over by the alignment of the models' frames.

    Raises:
        ModelMismatchError: The table belongs to another model than ``source``.
        UsageError: As ``find_transfer``.
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
    """Minimises |target - source|^2 + lambda |c|^2 for every source face at once."""
    vertices, corners, weights = pairs
    source_points = aligned.apply((source.mean[corners] * weights[..., None]).sum(axis=1, dtype=np.float64))
    source_basis = aligned.turn(
        np.concatenate(
            [
                np.stack(
                    [(component[corners] * weights[..., None]).sum(axis=1, dtype=np.float64) for component in basis]
                )
                for basis in (source.identity_basis, source.expression_basis)
                if len(basis)
            ]
        )
    )
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
    """For face vertices of the target's mean the closest points of the source's: corners and barycentric weights."""
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
