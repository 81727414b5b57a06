"""The meshes of a scene in the driver: the head, whose triangles stay, and objects that come and go."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import moderngl
import numpy as np
from jaxtyping import Float, Float32, Int32, Int64
from numpy import ndarray

from datagen.appearance.scene import PosedHead, SceneMesh
from datagen.rendering.scene_program import SceneProgram
from pix2face.errors import UsageError
from pix2face.morphable_model import MorphableModel

# Blended meshes that lie within one another are drawn in turns, far to near, in at most so many draws.
MAX_TURNS = 24
FLOATS_PER_VERTEX = 8  # position, normal, uv
LAYOUT, LAYOUT_NAMES = "3f4 3f4 2f4", ("vertex", "normal", "uv")


@final
class HeadMesh:
    """The head, its vertices split where texture coordinates are.

    Args:
        model: Triangles and texture coordinates; without these, uv is 0.
        context: Where.
        paint: Eight numbers for each vertex of the model, for ``skin.glsl``.
        occlusion: How much ambient light arrives at each vertex, 0..1.
    """

    def __init__(
        self,
        model: MorphableModel,
        context: moderngl.Context,
        paint: Float32[ndarray, "v 8"],
        occlusion: Float32[ndarray, " v"],
    ) -> None:
        n_vertices = len(model.mean)
        if paint.shape != (n_vertices, 8) or occlusion.shape != (n_vertices,):
            raise UsageError(
                f"expected paint and occlusion of {n_vertices:,} vertices, found {paint.shape} and {occlusion.shape}"
            )
        self._context = context
        self._source, uv, triangles = split_by_uv(model)
        self.n_triangles = len(triangles)
        static = np.concatenate(
            [uv, model.mean[self._source], paint[self._source], occlusion[self._source, None]], axis=1
        )
        self._static = context.buffer(np.ascontiguousarray(static, dtype=np.float32))
        self._posed: Float32[ndarray, "s 6"] = np.empty((len(self._source), 6), dtype=np.float32)
        self._moving = context.buffer(reserve=self._posed.nbytes, dynamic=True)
        self._triangles = context.buffer(triangles)
        self._arrays: list[moderngl.VertexArray] = []

    def load(self, head: PosedHead) -> None:
        """Uploads a face."""
        np.take(head.vertices, self._source, axis=0, out=self._posed[:, :3])
        np.take(head.normals, self._source, axis=0, out=self._posed[:, 3:])
        self._moving.write(self._posed)

    def painted(self, program: SceneProgram) -> moderngl.VertexArray:
        """The head with all that paints it."""
        static = (self._static, "2f4 3f4 4f4 4f4 1f4", "uv", "place", "paint0", "paint1", "occlusion")
        return self._array(program, (self._moving, "3f4 3f4", "vertex", "normal"), static)

    def bare(self, program: SceneProgram) -> moderngl.VertexArray:
        """The head's place alone."""
        return self._array(program, (self._moving, "3f4 12x1", "vertex"))

    def release(self) -> None:
        """Gives everything back to the driver."""
        for each in (*self._arrays, self._static, self._moving, self._triangles):
            each.release()

    def _array(self, program: SceneProgram, *content: tuple[object, ...]) -> moderngl.VertexArray:
        array = self._context.vertex_array(
            program.program, [_known(program, each) for each in content], self._triangles
        )
        self._arrays.append(array)
        return array


@final
@dataclass(frozen=True)
class Run:
    """Triangles of one mesh that are drawn at once.

    Attributes:
        mesh: Which of the scene's meshes.
        first: Where they begin, in corners.
        count: How many corners.
    """

    mesh: int
    first: int
    count: int


@final
class ObjectMeshes:
    """All meshes of a scene but the head's, in one buffer of vertices and one of triangles.

    Args:
        context: Where.
        programs: What may draw them, by name.

    Attributes:
        opaque: Runs of meshes that hide what is behind.
        blended: Runs of the others, far to near.
    """

    def __init__(self, context: moderngl.Context, programs: Mapping[str, SceneProgram]) -> None:
        self._context, self._programs = context, programs
        self.opaque: list[Run] = []
        self.blended: list[Run] = []
        self._vertices = self._corners = None
        self._arrays: dict[str, moderngl.VertexArray] = {}

    def load(self, meshes: Sequence[SceneMesh], depth_row: Float[ndarray, "4"]) -> None:
        """Uploads the meshes of a scene; ``depth_row`` gives the depth of points, the farther the larger."""
        self.opaque, self.blended = [], []
        if not meshes:
            return
        for mesh in meshes:
            _check(mesh)
        starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        vertices = np.empty((starts[-1], FLOATS_PER_VERTEX), dtype=np.float32)
        for mesh, start in zip(meshes, starts, strict=False):
            rows = vertices[start : start + len(mesh.vertices)]
            rows[:, :3], rows[:, 3:6], rows[:, 6:] = mesh.vertices, mesh.normals, mesh.uv
        solid = [place for place, mesh in enumerate(meshes) if not mesh.material.is_blended]
        soft = [place for place, mesh in enumerate(meshes) if mesh.material.is_blended]
        parts, first = [], 0
        for place in solid:
            parts.append(meshes[place].triangles + np.int32(starts[place]))
            self.opaque.append(Run(place, first, parts[-1].size))
            first += parts[-1].size
        if soft:
            triangles = [meshes[place].triangles + np.int32(starts[place]) for place in soft]
            depth = vertices[:, :3] @ depth_row[:3].astype(np.float32)
            order, turns = far_to_near(triangles, depth)
            parts.append(np.concatenate(triangles)[order])
            for which, count in turns:
                self.blended.append(Run(soft[which], first, 3 * count))
                first += 3 * count
        self._upload(vertices, np.concatenate(parts))

    def draw(self, name: str, run: Run) -> None:
        """Draws a run with one of the programs."""
        self._arrays[name].render(moderngl.TRIANGLES, vertices=run.count, first=run.first)

    def release(self) -> None:
        """Gives everything back to the driver."""
        for each in (*self._arrays.values(), self._vertices, self._corners):
            if each is not None:
                each.release()
        self._arrays, self._vertices, self._corners = {}, None, None

    def _upload(self, vertices: Float32[ndarray, "v 8"], corners: Int32[ndarray, "t 3"]) -> None:
        if self._vertices is None or self._vertices.size < vertices.nbytes or self._corners.size < corners.nbytes:
            self.release()
            # Half as much again: the next scene may have longer hair.
            self._vertices = self._context.buffer(reserve=vertices.nbytes * 3 // 2, dynamic=True)
            self._corners = self._context.buffer(reserve=corners.nbytes * 3 // 2, dynamic=True)
            for name, program in self._programs.items():
                content = _known(program, (self._vertices, LAYOUT, *LAYOUT_NAMES))
                self._arrays[name] = self._context.vertex_array(program.program, [content], self._corners)
        self._vertices.write(vertices)
        self._corners.write(np.ascontiguousarray(corners, dtype=np.int32))


def split_by_uv(
    model: MorphableModel,
) -> tuple[Int64[ndarray, " s"], Float32[ndarray, "s 2"], Int32[ndarray, "t 3"]]:
    """Vertices that stand once for each texture coordinate they have.

    Returns:
        The model's vertex of each, its texture coordinates with v downward, and the triangles over them.
    """
    if model.uv is None or model.uv_triangles is None:
        n_vertices = len(model.mean)
        return np.arange(n_vertices), np.zeros((n_vertices, 2), dtype=np.float32), np.ascontiguousarray(model.triangles)
    key = model.triangles.reshape(-1).astype(np.int64) << 32 | model.uv_triangles.reshape(-1)
    split, corners = np.unique(key, return_inverse=True)
    uv = model.uv[split & 0xFFFFFFFF] * np.array([1, -1], dtype=np.float32) + np.array([0, 1], dtype=np.float32)
    # Vertices without a triangle are left out: nothing draws them.
    return split >> 32, uv, np.ascontiguousarray(corners.reshape(-1, 3), dtype=np.int32)


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
    if len(triangles) == 1:
        return np.argsort(-middle, kind="stable"), [(0, len(owner))]
    low, extent = float(middle.min()), max(float(np.ptp(middle)), 1e-6)
    mean = np.bincount(owner, weights=middle) / np.maximum(np.bincount(owner), 1)
    rank = np.empty(len(mean), dtype=np.int64)
    rank[np.argsort(-mean, kind="stable")] = np.arange(len(mean))
    for slabs in (256, 64, 32, 16, 8, 4, 2, 1):
        slab = np.minimum((slabs * (1 - (middle - low) / extent)).astype(np.int64), slabs - 1)
        order = np.lexsort((-middle, rank[owner], slab))
        starts = np.flatnonzero(np.diff(owner[order], prepend=-1))
        if len(starts) <= max(MAX_TURNS, len(triangles)):
            break
    counts = np.diff(np.append(starts, len(owner)))
    return order, [(int(owner[order[start]]), int(count)) for start, count in zip(starts, counts, strict=True)]


def _known(program: SceneProgram, content: tuple[object, ...]) -> tuple[object, ...]:
    """A buffer's layout without the attributes that the program's compiler has dropped."""
    buffer, layout, *names = content
    formats = str(layout).split()
    kept, used = [], []
    for place, form in enumerate(formats):
        name = names[place] if place < len(names) else None
        if name is not None and name in program.program:
            kept.append(form)
            used.append(name)
        else:
            kept.append(form if "x" in form else f"{4 * int(form[0])}x1")
    return (buffer, " ".join(kept), *used)


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
