"""A tracked face as one ``.glb``: a mesh with morph targets, and their weights in each frame.

There is a morph target for each component of the expression. The mesh of a frame is exactly that of its fit, because
the model is linear. Weights are from 0 to 1, since Blender 5.0 cuts off others: a target is the range that its
component takes in the clip, 0 included, and the mesh itself has the smallest value of each component. Extras of the
mesh say which weights make the neutral face, and how many standard deviations a weight of 1 is.

Source: glTF 2.0 specification.
"""

import json
import math
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, final

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from pix2face.files.writing import write_file
from pix2face.geometry.other_cameras import M_PER_MM, NEAREST_SEEN_M, ORTHOGRAPHIC_DISTANCE_MM
from pix2face.models.morphable_model import MorphableModel
from pix2face.tracking.export.clip_scene import ClipScene, HeadMotion

# Chapter 5 and Section 4.4 of the specification.
FLOAT, UNSIGNED_INT = 5126, 5125
VERTEX_DATA, INDICES = 34962, 34963
GLB_MAGIC, JSON_CHUNK, BINARY_CHUNK = 0x46546C67, 0x4E4F534A, 0x004E4942

Shape = Literal["SCALAR", "VEC3", "VEC4"]


def write_clip_glb(path: Path, scene: ClipScene) -> None:
    """Writes a scene, at least one frame of which shows the face."""
    binary, motion, morph = _Binary(), scene.motion(), _Morph.of(scene.expressions)
    head = {"name": "head", "mesh": 0}
    camera: dict[str, Any] = {"name": "video", "camera": 0}
    # A camera's focal length cannot vary, so depths do: a node between camera and head has the ratio of focal lengths.
    nodes = [camera, head] if motion.focal_px is None else [camera, head, {"name": "lens", "children": [1]}]
    tree = {
        "asset": {"version": "2.0", "generator": "pix2face", "extras": {"model": scene.model.name}},
        "scene": 0,
        "scenes": [{"nodes": [0, len(nodes) - 1]}],
        "nodes": nodes,
        "cameras": [{"name": "video", **_lens(motion, scene.size_px)}],
        "meshes": [_mesh(scene, morph, binary)],
        "materials": [{"name": "face", "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
        "animations": [_animation(scene, motion, morph, binary)],
        "accessors": binary.accessors,
        "bufferViews": binary.views,
        "buffers": [{"byteLength": len(binary.content)}],
    }
    write_file(path, _glb(tree, binary.content))


def target_names(model: MorphableModel) -> list[str]:
    """What the morph targets are called: after named expressions that are one component, otherwise by their number."""
    names = [f"expression{index:02d}" for index in range(model.n_expression)]
    for name, coefficients in model.named_expressions.items():
        (used,) = np.nonzero(coefficients)
        if len(used) == 1 and coefficients[used[0]] > 0:
            names[int(used[0])] = name
    return names


@final
@dataclass(eq=False)
class _Binary:
    """The binary part of the file, and where its arrays are."""

    content: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)

    def add(self, values: ndarray, shape: Shape, target: int | None = None) -> int:
        """Appends an array as 32-bit numbers, one element a row; returns the number of its accessor."""
        is_whole = values.dtype.kind in "iu"
        flat = values.astype("<u4" if is_whole else "<f4").reshape(-1, {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[shape])
        view = {"buffer": 0, "byteOffset": len(self.content), "byteLength": flat.nbytes}
        self.views.append(view if target is None else view | {"target": target})
        self.content += flat.tobytes()
        self.accessors.append(
            {
                "bufferView": len(self.views) - 1,
                "componentType": UNSIGNED_INT if is_whole else FLOAT,
                "count": len(flat),
                "type": shape,
                "min": flat.min(axis=0).tolist(),
                "max": flat.max(axis=0).tolist(),
            }
        )
        return len(self.accessors) - 1


def _mesh(scene: ClipScene, morph: "_Morph", binary: _Binary) -> dict[str, Any]:
    model = scene.model
    basis = model.expression_basis.reshape(model.n_expression, model.mean.size)
    points = scene.neutral_vertices() + (morph.least @ basis).reshape(-1, 3)
    primitive: dict[str, Any] = {
        "attributes": {"POSITION": binary.add(points * M_PER_MM, "VEC3", VERTEX_DATA)},
        "indices": binary.add(model.triangles, "SCALAR", INDICES),
        "material": 0,
    }
    mesh: dict[str, Any] = {"name": "face", "primitives": [primitive]}
    if not model.n_expression:
        return mesh
    targets = [range_ * own * M_PER_MM for range_, own in zip(morph.ranges, model.expression_basis, strict=True)]
    primitive["targets"] = [{"POSITION": binary.add(own, "VEC3", VERTEX_DATA)} for own in targets]
    extras = {
        "targetNames": target_names(model),  # where Blender and three.js look for them
        "neutralWeights": (-morph.least / morph.ranges).tolist(),
        "deviationsPerWeight": morph.ranges.tolist(),
    }
    return mesh | {"weights": morph.weights[0].tolist(), "extras": extras}


@final
@dataclass(frozen=True, eq=False)
class _Morph:
    """The range of each component of the expression, in standard deviations, and the weights of the frames in it."""

    least: Float64[ndarray, " e"]
    ranges: Float64[ndarray, " e"]
    weights: Float32[ndarray, "n e"]

    @classmethod
    def of(cls, expressions: Float32[ndarray, "n e"]) -> "_Morph":
        least = np.minimum(expressions.min(axis=0), 0).astype(np.float64)
        ranges = np.maximum(expressions.max(axis=0), 0) - least
        ranges[ranges == 0] = 1.0
        return cls(least, ranges, np.clip((expressions - least) / ranges, 0, 1).astype(np.float32))


def _animation(scene: ClipScene, motion: HeadMotion, morph: _Morph, binary: _Binary) -> dict[str, Any]:
    """Channels for weights and place of the head. A head that is not in a frame has no size there."""
    times = binary.add(np.array(scene.times_s), "SCALAR")
    sizes = np.where(scene.is_there, motion.scales, 0.0)
    outputs: list[tuple[int, str, int]] = [
        (1, "rotation", binary.add(motion.quaternions, "VEC4")),
        (1, "translation", binary.add(motion.translations_m, "VEC3")),
        (1, "scale", binary.add(np.repeat(sizes[:, None], 3, axis=1), "VEC3")),
    ]
    if scene.model.n_expression:
        outputs.append((1, "weights", binary.add(morph.weights, "SCALAR")))
    if motion.focal_px is not None:
        depths = np.ones((len(sizes), 3))
        depths[:, 2] = np.median(motion.focal_px) / motion.focal_px
        outputs.append((2, "scale", binary.add(depths, "VEC3")))
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


def _glb(tree: dict[str, Any], content: bytearray) -> bytes:
    text = json.dumps(tree, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)  # chunks end at multiples of four bytes; arrays of 32-bit numbers do anyway
    head = struct.pack("<III", GLB_MAGIC, 2, 28 + len(text) + len(content))
    chunks = (struct.pack("<II", len(text), JSON_CHUNK), text, struct.pack("<II", len(content), BINARY_CHUNK), content)
    return b"".join((head, *chunks))
