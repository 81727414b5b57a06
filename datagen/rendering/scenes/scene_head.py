"""The head of a scene: its triangles, and textures for shading them."""

from typing import final

import moderngl
import numpy as np
from jaxtyping import Float32, Int32, Int64
from numpy import ndarray

from datagen.appearance.scene import PosedHead
from datagen.rendering.gl_mesh import list_texture, padded_list
from datagen.rendering.scenes.scene_openings import WITHIN
from datagen.rendering.scenes.scene_program import UNITS
from pix2face.errors import UsageError
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.surface_attributes import split_at_seams, vertex_normals

# Shadows are cast by a coarser head: the vertices in a cube of this size become one.
SHADOW_CELL_MM = 6.0


@final
class SceneHead:
    """The head of a scene. In its textures a vertex stands once for each texture coordinate that it has.

    Each vertex of the model has a paint of eight numbers, for ``skin.glsl``, and an occlusion: the share (0 to 1) of
    the ambient light that arrives at it. Without texture coordinates, uv is 0.

    Attributes:
        triangles: Of the whole head, over the model's vertices.
        coarse: The coarser head that casts the shadows: numbers of its vertices in the model, and triangles over them.
        kinds: Which of `HEAD_KINDS` paints each triangle of the whole head.
    """

    def __init__(
        self,
        model: MorphableModel,
        context: moderngl.Context,
        paint: Float32[ndarray, "n 8"],
        occlusion: Float32[ndarray, " m"],
    ) -> None:
        n_vertices = len(model.mean)
        if len(paint) != n_vertices or len(occlusion) != n_vertices:
            raise UsageError(
                f"expected paint and occlusion of {n_vertices:,} vertices, found {len(paint):,} and {len(occlusion):,}"
            )
        self._source, uv, triangles = split_by_uv(model)
        self._moving = {name: padded_list(len(self._source)) for name in ("positions", "normals")}
        for place, values in enumerate(self._moving.values()):
            values[: len(uv), 3] = uv[:, place]
        home = np.concatenate([model.mean, occlusion[:, None]], axis=1)[self._source]
        lists = {
            "places": home,
            "paint0": paint[self._source, :4],
            "paint1": paint[self._source, 4:],
            "corners": np.column_stack([triangles, np.zeros(len(triangles), dtype=np.int32)]),
            **self._moving,
        }
        self._textures = {f"head_{name}": list_texture(context, each) for name, each in lists.items()}
        self.triangles: Int32[ndarray, "t 3"] = np.ascontiguousarray(model.triangles, dtype=np.int32)
        coarse = coarse_triangles(model)
        chosen, corners = np.unique(coarse, return_inverse=True)
        self.coarse = chosen, corners.reshape(coarse.shape).astype(np.int32)
        self.kinds = painted_kinds(uv, triangles)

    def load(self, head: PosedHead) -> None:
        """Uploads a face, and binds the textures that shade it."""
        for (name, moving), values in zip(self._moving.items(), (head.vertices, head.normals), strict=True):
            moving[: len(self._source), :3] = values.take(self._source, axis=0)  # three times as fast as by brackets
            self._textures[f"head_{name}"].write(moving)
        for name, texture in self._textures.items():
            texture.use(UNITS[name])


def split_by_uv(
    model: MorphableModel,
) -> tuple[Int64[ndarray, " s"], Float32[ndarray, "s 2"], Int32[ndarray, "t 3"]]:
    """As `split_at_seams`, but v is downward, and 0 as u is where there are no texture coordinates."""
    if model.uv is None or model.uv_triangles is None:
        n_vertices = len(model.mean)
        return np.arange(n_vertices), np.zeros((n_vertices, 2), dtype=np.float32), np.ascontiguousarray(model.triangles)
    source, uv, triangles = split_at_seams(model)
    downward = uv.astype(np.float32) * np.array([1, -1], dtype=np.float32) + np.array([0, 1], dtype=np.float32)
    return source, downward, np.ascontiguousarray(triangles, dtype=np.int32)


def painted_kinds(uv: Float32[ndarray, "s 2"], triangles: Int32[ndarray, "t 3"]) -> Int32[ndarray, " t"]:
    """Which of ``HEAD_KINDS`` paints each triangle, by islands of MakeHuman's texture coordinates, v downward."""
    u, v = uv[triangles].mean(axis=1).T
    eyes = (u > 0.75) & (v < 0.075)
    inside = ((v < 0.13) | (v > 0.86) | (u < 0.2)) & ~((u > 0.32) & (u < 0.45))
    return np.where(eyes, 1, np.where(inside, 2, 0)).astype(np.int32)


def coarse_triangles(model: MorphableModel) -> Int32[ndarray, "u 3"]:
    """Triangles of a coarser head: near vertices that face alike become one of them.

    A vertex stays where the face moves it, so the coarse head follows expressions. Lips and lids that touch face in
    different directions and stay apart.
    """
    mean = model.mean.astype(np.float64)
    normals = vertex_normals(mean, model.triangles)
    octant = (normals[:, :2] > 0) @ [1, 2]
    cell = np.floor(mean / SHADOW_CELL_MM).astype(np.int64)
    _, group = np.unique(np.column_stack([cell, octant]), axis=0, return_inverse=True)
    group = group.reshape(-1)
    centre = np.stack([np.bincount(group, weights=axis) for axis in mean.T], axis=1) / np.bincount(group)[:, None]
    by_distance = np.lexsort((np.linalg.norm(mean - centre[group], axis=1), group))
    chosen = by_distance[np.unique(group[by_distance], return_index=True)[1]]
    outer = ~model.triangles_of(*WITHIN)
    coarse = chosen[group[model.triangles[outer]]]
    whole = (coarse != np.roll(coarse, 1, axis=1)).all(axis=1)
    return np.ascontiguousarray(np.unique(coarse[whole], axis=0), dtype=np.int32)
