"""The morphable model in memory: X = mean + identity + expression, with the tables that belong to the mesh.

Source: Blanz and Vetter 1999; Crispell and Bazik 2017, Eq. 3.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from importlib.resources import as_file, files
from pathlib import Path
from types import MappingProxyType
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int32, UInt8
from numpy import ndarray

from pix2face.geometry.landmarks import IBUG68_2D
from pix2face.models import BUILTIN_MODEL
from pix2face.models.model_file import LinearModel, StoredModel, read_stored_model
from pix2face.models.subdivision import refine

# Number of coordinates that expressions are added to at a time: 1 MiB of float32.
ADDED_AT_A_TIME = 1 << 18


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class MorphableModel(LinearModel):
    """A linear face model over one triangle mesh: what `LinearModel` describes, and its triangles."""

    sha256: str  #: hash of the content of its file, which shards and checkpoints carry
    triangles: Int32[ndarray, "t 3"]  #: vertex indices, counter-clockwise seen from outside
    triangle_regions: UInt8[ndarray, " t"]  #: indices into ``region_names``
    #: For each triangle its three texture coordinates (they split along seams).
    uv_triangles: Int32[ndarray, "t 3"] | None = None
    #: By scheme, how far each landmark lies from its vertex, mm in the model frame. Others lie at their vertices.
    landmark_offsets_mm: Mapping[str, Float64[ndarray, "m 3"]] = field(default_factory=dict)

    def __repr__(self) -> str:
        """The model in one line, without its arrays."""
        return (
            f"<MorphableModel {self.name!r}: {len(self.mean)} vertices, {self.n_identity} identity and "
            f"{self.n_expression} expression components>"
        )

    @property
    def n_identity(self) -> int:
        """Number of identity components."""
        return self.identity_basis.shape[0]

    @property
    def n_expression(self) -> int:
        """Number of expression components."""
        return self.expression_basis.shape[0]

    @property
    def is_face_triangle(self) -> Bool[ndarray, " t"]:
        """Which triangles belong to the regions where maps are valid."""
        return self.triangles_of(*self.face_regions)

    @property
    def is_face_vertex(self) -> Bool[ndarray, " v"]:
        """Which vertices belong to at least one face triangle."""
        is_face = np.zeros(len(self.mean), dtype=bool)
        is_face[self.triangles[self.is_face_triangle]] = True
        return is_face

    @cached_property
    def smallest_radius_mm(self) -> float:
        """Distance from the origin to the nearest point of the mean face; half of it separates face from background."""
        return float(np.linalg.norm(self.mean[self.is_face_vertex], axis=1).min())

    def triangles_of(self, *regions: str) -> Bool[ndarray, " t"]:
        """Which triangles belong to any of the given regions; regions that the model lacks are ignored."""
        return np.isin(self.region_names, regions)[self.triangle_regions]

    def vertices_of(self, *regions: str) -> Int32[ndarray, " n"]:
        """The vertices of the triangles of the given regions, in ascending order."""
        return np.unique(self.triangles[self.triangles_of(*regions)])

    def mean_landmarks(self, scheme: str) -> Float64[ndarray, "m 3"]:
        """The landmarks of a scheme on the mean face (mm): their vertices, moved by their offsets."""
        return np.asarray(self.mean[self.landmarks[scheme]] + self.landmark_offsets_mm.get(scheme, np.zeros(3)))

    def vertices(self, identity: Float[ndarray, "n k"], expression: Float[ndarray, "n e"]) -> Float32[ndarray, "n v 3"]:
        """The vertices (mm, model frame) of faces with the given coefficients, in standard deviations.

        Source: Crispell and Bazik 2017, Eq. 3.
        """
        n, expression = len(identity), expression.astype(np.float32)
        out = identity.astype(np.float32) @ self.identity_basis.reshape(self.n_identity, self.mean.size)
        basis, mean = self.expression_basis.reshape(self.n_expression, self.mean.size), self.mean.reshape(-1)
        # In blocks of columns, so that products fit into the cache and need no second array of the size of the result.
        width = max(ADDED_AT_A_TIME // max(n, 1), 1)
        for start in range(0, self.mean.size, width):
            columns = np.s_[start : start + width]
            out[:, columns] += expression @ basis[:, columns]
            out[:, columns] += mean[columns]
        return out.reshape(n, len(self.mean), 3)


def load_model(path: Path, refinement_steps: int | None = None) -> MorphableModel:
    """Reads a model from its ``.h5`` file, and refines its control mesh.

    The number of Catmull-Clark steps is that of the file unless it is given. The hash is that of the file, so maps of
    different refinements of one file are comparable.

    Raises:
        InputFileError: The file is missing, not a model, truncated, or of a newer schema.
    """
    stored, sha256 = read_stored_model(path)
    steps = stored.refinement_steps if refinement_steps is None else refinement_steps
    return model_from_stored(stored, sha256, steps)


@lru_cache(maxsize=2)
def builtin_model(refinement_steps: int | None = None) -> MorphableModel:
    """The model that comes with the package (CC0; see ASSETS.md)."""
    assets = files("pix2face") / "assets"
    with as_file(assets / "builtin_model.h5") as path:
        model = load_model(path, refinement_steps)
    # Beside the file, whose hash shards and checkpoints carry.
    with (assets / f"{IBUG68_2D}.txt").open() as table:
        marked = np.loadtxt(table)
    return replace(
        model,
        landmarks=MappingProxyType({**model.landmarks, IBUG68_2D: marked[:, 1].astype(np.int32)}),
        landmark_offsets_mm=MappingProxyType({IBUG68_2D: marked[:, 2:]}),
    )


def open_model(name_or_path: str) -> MorphableModel:
    """Opens ``builtin`` or a model file: what ``--model`` takes."""
    return builtin_model() if name_or_path == BUILTIN_MODEL else load_model(Path(name_or_path))


def model_from_stored(stored: StoredModel, sha256: str, refinement_steps: int) -> MorphableModel:
    """Refines a stored control mesh and cuts its polygons into triangles."""
    for _ in range(refinement_steps):
        stored = refine(stored)
    triangles, polygon_of_triangle = triangulate(stored.polygons)
    shared = {field.name: getattr(stored, field.name) for field in fields(LinearModel)}
    return MorphableModel(
        **shared | {"mean": _exactly_symmetric(stored.mean, stored.symmetry)},
        sha256=sha256,
        triangles=triangles,
        triangle_regions=stored.polygon_regions[polygon_of_triangle],
        uv_triangles=None if stored.uv_polygons is None else triangulate(stored.uv_polygons)[0],
    )


def triangulate(polygons: Int32[ndarray, "p 4"]) -> tuple[Int32[ndarray, "t 3"], Int32[ndarray, " t"]]:
    """Cuts quads along their first diagonal; a triangle has -1 in the last place.

    Returns the triangles, in the order of the polygons, and the polygon that each was cut from.
    """
    is_quad = polygons[:, 3] >= 0
    first, second = polygons[:, [0, 1, 2]], polygons[is_quad][:, [0, 2, 3]]
    polygon = np.concatenate([np.arange(len(polygons)), np.flatnonzero(is_quad)]).astype(np.int32)
    order = np.argsort(polygon, kind="stable")
    return np.concatenate([first, second])[order], polygon[order]


def _exactly_symmetric(mean: Float32[ndarray, "v 3"], symmetry: Int32[ndarray, " v"] | None) -> Float32[ndarray, "v 3"]:
    """Takes out the rounding that refinement leaves between left and right."""
    if symmetry is None:
        return mean
    mirrored = mean[symmetry] * np.array([-1, 1, 1], dtype=np.float32)
    return (mean + mirrored) * np.float32(0.5)
