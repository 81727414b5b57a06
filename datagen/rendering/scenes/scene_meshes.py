"""The objects of a scene, all but the head, on the GPU."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, final

import moderngl
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int32, Int64
from numpy import ndarray

from datagen.appearance.scene import SceneMesh
from datagen.rendering.processor.nearest import in_window, may_be_seen
from datagen.rendering.scenes.scene_program import MaterialKind, SceneProgram
from pix2face.errors import UsageError

# Blended meshes that lie within one another are drawn in turns, far to near, in at most so many draws.
MAX_TURNS = 24
LAYOUT = {"vertex": 3, "normal": 3, "uv": 2}  # numbers of each


@final
@dataclass(frozen=True)
class Run:
    """Triangles of one mesh that are drawn at once."""

    mesh: int  # number of the mesh in the scene
    first: int  # its first corner
    count: int


class Window(NamedTuple):
    """What an OpenGL pass can show."""

    clip_from_model: Float64[ndarray, "4 4"]
    farthest: Float32[ndarray, "h w"]  # depth in the buffer, 0 to 1, behind which nothing is drawn


@final
class ObjectMeshes:
    """All meshes of a scene but the head's, in one buffer of vertices and one of triangles; programs go by name."""

    def __init__(self, context: moderngl.Context, programs: Mapping[str, SceneProgram]) -> None:
        self._context, self._programs = context, programs
        self.opaque: list[Run] = []
        self._soft: list[tuple[int, Int32[ndarray, "_ 3"]]] = []  # transparent meshes: number and triangles
        self._points: Float32[ndarray, "v 3"] = np.zeros((0, 3), dtype=np.float32)
        self._n_opaque = 0  # corners of opaque triangles
        self._vertices: moderngl.Buffer | None = None
        self._corners: moderngl.Buffer | None = None
        self._arrays: dict[str, moderngl.VertexArray] = {}

    def load(self, meshes: Sequence[SceneMesh]) -> None:
        """Uploads the meshes of a scene, without transparent triangles: `soft` and `blended` upload those."""
        self.opaque, self._soft, self._n_opaque = [], [], 0
        if not meshes:
            return
        for mesh in meshes:
            _check(mesh)
        starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        vertices = np.empty((starts[-1], sum(LAYOUT.values())), dtype=np.float32)
        parts = []
        for place, (mesh, start) in enumerate(zip(meshes, starts, strict=False)):
            rows = vertices[start : start + len(mesh.vertices)]
            rows[:, :3], rows[:, 3:6], rows[:, 6:] = mesh.vertices, mesh.normals, mesh.uv
            triangles = mesh.triangles + np.int32(start)
            if not len(triangles):
                continue  # under a hat nothing may be left of a head's hair
            if mesh.material.is_blended:
                self._soft.append((place, triangles))
                continue
            parts.append(triangles)
            self.opaque.append(Run(place, self._n_opaque, triangles.size))
            self._n_opaque += triangles.size
        self._points = vertices[:, :3]
        self._upload(vertices, parts)

    def soft(self, window: Window, meshes: Collection[int]) -> list[Run]:
        """Uploads the triangles of the given transparent meshes that may be seen, mesh by mesh."""
        chosen = [(place, triangles) for place, triangles in self._soft if place in meshes]
        seen = self._may_be_seen(window, [triangles for _, triangles in chosen])
        parts = [triangles[kept] for (_, triangles), kept in zip(chosen, seen, strict=True)]
        return self._upload_soft(parts, [(place, len(part)) for (place, _), part in zip(chosen, parts, strict=True)])

    def blended(self, window: Window, depth_row: Float[ndarray, "4"]) -> list[Run]:
        """Uploads the triangles of all transparent meshes that may be seen, from far to near.

        ``depth_row`` gives the depth of points, the farther the larger.
        """
        if not self._soft:
            return []
        triangles = [each for _, each in self._soft]
        seen = np.concatenate(self._may_be_seen(window, triangles))
        order, turns = far_to_near(triangles, self._points @ depth_row[:3].astype(np.float32))
        kept = seen[order]
        starts = np.cumsum([0, *(count for _, count in turns[:-1])])
        counts = np.add.reduceat(kept, starts, dtype=np.int64).tolist()
        places = [self._soft[own][0] for own, _ in turns]
        return self._upload_soft([np.concatenate(triangles)[order[kept]]], list(zip(places, counts, strict=True)))

    def kinds(self, meshes: Sequence[SceneMesh]) -> dict[str, set[MaterialKind]]:
        """Which kinds of objects the loaded scene draws, by ``PURPOSES``."""
        solid = {meshes[run.mesh].material.kind for run in self.opaque}
        soft = {meshes[place].material.kind for place, _ in self._soft}
        return {"object": solid, "blended": soft, "object_shadow": soft}

    def draw(self, name: str, run: Run) -> None:
        """Draws a run with one of the programs."""
        self._arrays[name].render(moderngl.TRIANGLES, vertices=run.count, first=run.first)

    def _may_be_seen(self, window: Window, triangles: Sequence[Int32[ndarray, "_ 3"]]) -> list[Bool[ndarray, " _"]]:
        placed = in_window(self._points, window.clip_from_model, *window.farthest.shape)
        return [may_be_seen(placed, each, window.farthest) for each in triangles]

    def _upload_soft(self, parts: Sequence[Int32[ndarray, "_ 3"]], counts: Sequence[tuple[int, int]]) -> list[Run]:
        """Uploads transparent triangles behind the opaque ones, given the number of each mesh and of its triangles."""
        first = self._n_opaque
        runs = []
        for place, count in counts:
            if count:
                runs.append(Run(place, first, 3 * count))
                first += 3 * count
        if parts:
            assert self._corners is not None
            self._corners.write(np.concatenate(parts), offset=4 * self._n_opaque)
        return runs

    def _upload(self, vertices: Float32[ndarray, "v 8"], opaque: Sequence[Int32[ndarray, "_ 3"]]) -> None:
        kept = self._vertices, self._corners
        n_soft = sum(triangles.size for _, triangles in self._soft)
        wanted = vertices.nbytes, 4 * (self._n_opaque + n_soft)
        if any(buffer is None or buffer.size < size for buffer, size in zip(kept, wanted, strict=True)):
            # Half as much again: the next scene may have longer hair.
            self._vertices, self._corners = (
                self._context.buffer(reserve=max(size * 3 // 2, 4), dynamic=True) for size in wanted
            )
            for name, program in self._programs.items():
                content = (self._vertices, *_layout(program))
                self._arrays[name] = self._context.vertex_array(program.program, [content], self._corners)
        assert self._vertices is not None
        assert self._corners is not None
        self._vertices.write(vertices)
        if opaque:
            self._corners.write(np.concatenate(opaque))


def far_to_near(
    triangles: Sequence[Int32[ndarray, "_ 3"]], depth: Float32[ndarray, " v"]
) -> tuple[Int64[ndarray, " t"], list[tuple[int, int]]]:
    """An order of the triangles of several meshes from far to near, and which mesh has its turn for how many of them.

    Meshes that lie within one another take turns; where that takes too many, the order of triangles of different
    meshes is kept in coarser and coarser slabs of depth, down to the order of the meshes' mean depths.
    """
    owner = np.repeat(np.arange(len(triangles)), [len(each) for each in triangles])
    corners = np.concatenate(triangles)
    middle = depth[corners[:, 0]] + depth[corners[:, 1]] + depth[corners[:, 2]]
    order = np.argsort(-middle, kind="stable")
    if len(triangles) == 1:
        return order, [(0, len(owner))]
    mean = np.bincount(owner, weights=middle) / np.maximum(np.bincount(owner), 1)
    rank = np.empty(len(mean), dtype=np.int64)
    rank[np.argsort(-mean, kind="stable")] = np.arange(len(mean))
    by_depth, sorted_rank, sorted_depth = order, rank[owner[order]], middle[order]
    share = (sorted_depth[0] - sorted_depth) / max(float(sorted_depth[0] - sorted_depth[-1]), 1e-6)
    for slabs in (256, 64, 32, 16, 8, 4, 2, 1):
        slab = np.minimum((slabs * share).astype(np.int64), slabs - 1)
        key = slab * len(mean) + sorted_rank
        # Numbers of 16 bits are sorted in one go.
        order = by_depth[np.argsort(key.astype(np.uint16) if key.max() < 1 << 16 else key, kind="stable")]
        starts = np.flatnonzero(np.diff(owner[order], prepend=-1))
        if len(starts) <= max(MAX_TURNS, len(triangles)):
            break
    counts = np.diff(np.append(starts, len(owner)))
    return order, [(int(owner[order[start]]), int(count)) for start, count in zip(starts, counts, strict=True)]


def _layout(program: SceneProgram) -> tuple[str, ...]:
    """The layout of a vertex without the attributes that the program's compiler has dropped."""
    used = [name for name in LAYOUT if name in program.attributes]
    forms = [f"{n}f4" if name in used else f"{4 * n}x1" for name, n in LAYOUT.items()]
    return (" ".join(forms), *used)


def _check(mesh: SceneMesh) -> None:
    n_vertices = len(mesh.vertices)
    shapes = (mesh.vertices.shape, mesh.normals.shape, mesh.uv.shape)
    if shapes != ((n_vertices, 3), (n_vertices, 3), (n_vertices, 2)):
        raise UsageError(f"mesh {mesh.name}: expected vertices, normals and uv of one length, found {shapes}")
    if len(mesh.triangles) and not 0 <= mesh.triangles.min() <= mesh.triangles.max() < n_vertices:
        raise UsageError(
            f"mesh {mesh.name}: expected triangles over {n_vertices} vertices, found vertex numbers from "
            f"{mesh.triangles.min()} to {mesh.triangles.max()}"
        )
    if not np.isfinite(mesh.vertices).all():
        raise UsageError(f"mesh {mesh.name}: expected finite vertices, found others")
