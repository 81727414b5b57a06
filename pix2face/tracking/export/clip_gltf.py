"""Writes a tracked face as ``.glb``: a mesh with morph targets, and their weights in each frame.

There is a morph target for each component of the expression. The mesh of a frame is exactly that of its fit, because
the model is linear. Blender 5.0 clips weights to 0..1. A target is therefore the range of its component in the clip,
including 0, and the mesh has the smallest value of each component. Extras of the mesh have the weights of the neutral
face, and the number of standard deviations of a weight of 1.

Source: glTF 2.0 specification.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from pix2face.files.meshes.glb import INDICES, VERTEX_DATA, GlbContent
from pix2face.files.writing import write_file
from pix2face.geometry.other_cameras import M_PER_MM, NEAREST_SEEN_M, ORTHOGRAPHIC_DISTANCE_MM
from pix2face.models.morphable_model import MorphableModel
from pix2face.tracking.export.clip_scene import ClipScene, HeadMotion


def write_clip_glb(path: Path, scene: ClipScene) -> None:
    """Writes a scene in which at least one frame shows the face."""
    content, motion, morph = GlbContent(), scene.motion(), _Morph.of(scene.expressions)
    head = {"name": "head", "mesh": 0}
    camera: dict[str, Any] = {"name": "video", "camera": 0}
    # The focal length cannot be animated, so depths are: a node between camera and head has the ratio of focal lengths.
    nodes = [camera, head] if motion.focal_px is None else [camera, head, {"name": "lens", "children": [1]}]
    tree = {
        "asset": {"version": "2.0", "generator": "pix2face", "extras": {"model": scene.model.name}},
        "scene": 0,
        "scenes": [{"nodes": [0, len(nodes) - 1]}],
        "nodes": nodes,
        "cameras": [{"name": "video", **_lens(motion, scene.size_px)}],
        "meshes": [_mesh(scene, morph, content)],
        "materials": [{"name": "face", "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
        "animations": [_animation(scene, motion, morph, content)],
    }
    write_file(path, content.file(tree))


def target_names(model: MorphableModel) -> list[str]:
    """Returns the names of the morph targets: named expressions of a single component, or else numbers."""
    names = [f"expression{index:02d}" for index in range(model.n_expression)]
    for name, coefficients in model.named_expressions.items():
        (used,) = np.nonzero(coefficients)
        if len(used) == 1 and coefficients[used[0]] > 0:
            names[int(used[0])] = name
    return names


def _mesh(scene: ClipScene, morph: "_Morph", content: GlbContent) -> dict[str, Any]:
    model = scene.model
    basis = model.expression_basis.reshape(model.n_expression, model.mean.size)
    points = scene.neutral_vertices() + (morph.least @ basis).reshape(-1, 3)
    primitive: dict[str, Any] = {
        "attributes": {"POSITION": content.add(points * M_PER_MM, "VEC3", VERTEX_DATA)},
        "indices": content.add(model.triangles, "SCALAR", INDICES),
        "material": 0,
    }
    mesh: dict[str, Any] = {"name": "face", "primitives": [primitive]}
    if not model.n_expression:
        return mesh
    targets = [range_ * own * M_PER_MM for range_, own in zip(morph.ranges, model.expression_basis, strict=True)]
    primitive["targets"] = [{"POSITION": content.add(own, "VEC3", VERTEX_DATA)} for own in targets]
    extras = {
        "targetNames": target_names(model),  # read by Blender and three.js
        "neutralWeights": (-morph.least / morph.ranges).tolist(),
        "deviationsPerWeight": morph.ranges.tolist(),
    }
    return mesh | {"weights": morph.weights[0].tolist(), "extras": extras}


@final
@dataclass(frozen=True, eq=False)
class _Morph:
    """The range of each component of the expression, and the weights of the frames."""

    least: Float64[ndarray, " e"]  # smallest value, standard deviations
    ranges: Float64[ndarray, " e"]  # largest minus smallest value
    weights: Float32[ndarray, "n e"]  # 0 at the smallest value, 1 at the largest

    @classmethod
    def of(cls, expressions: Float32[ndarray, "n e"]) -> "_Morph":
        least = np.minimum(expressions.min(axis=0), 0).astype(np.float64)
        ranges = np.maximum(expressions.max(axis=0), 0) - least
        ranges[ranges == 0] = 1.0
        return cls(least, ranges, np.clip((expressions - least) / ranges, 0, 1).astype(np.float32))


def _animation(scene: ClipScene, motion: HeadMotion, morph: _Morph, content: GlbContent) -> dict[str, Any]:
    """Returns the channels of weights and head motion. The scale is 0 in frames without the face."""
    times = content.add(np.array(scene.times_s), "SCALAR")
    sizes = np.where(scene.is_there, motion.scales, 0.0)
    outputs: list[tuple[int, str, int]] = [
        (1, "rotation", content.add(motion.quaternions, "VEC4")),
        (1, "translation", content.add(motion.translations_m, "VEC3")),
        (1, "scale", content.add(np.repeat(sizes[:, None], 3, axis=1), "VEC3")),
    ]
    if scene.model.n_expression:
        outputs.append((1, "weights", content.add(morph.weights, "SCALAR")))
    if motion.focal_px is not None:
        depths = np.ones((len(sizes), 3))
        depths[:, 2] = np.median(motion.focal_px) / motion.focal_px
        outputs.append((2, "scale", content.add(depths, "VEC3")))
    return {
        "name": "clip",
        "samplers": [{"input": times, "interpolation": "LINEAR", "output": output} for _, _, output in outputs],
        "channels": [
            {"sampler": index, "target": {"node": node, "path": path}} for index, (node, path, _) in enumerate(outputs)
        ],
    }


def _lens(motion: HeadMotion, size_px: tuple[int, int]) -> dict[str, Any]:
    height, width = size_px
    if motion.focal_px is not None:
        field_of_view = 2 * math.atan(height / 2 / float(np.median(motion.focal_px)))
        lens = {"yfov": field_of_view, "aspectRatio": width / height, "znear": NEAREST_SEEN_M}
        return {"type": "perspective", "perspective": lens}
    assert motion.width_m is not None
    sides = {"xmag": motion.width_m / 2, "ymag": motion.width_m / 2 * height / width}
    depths = {"znear": NEAREST_SEEN_M, "zfar": 2 * ORTHOGRAPHIC_DISTANCE_MM * M_PER_MM}
    return {"type": "orthographic", "orthographic": sides | depths}
