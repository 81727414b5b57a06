"""Pixels of meshes in scenes, as independent readers find them: pygltflib and USD's own library."""

from pathlib import Path

import numpy as np
import pygltflib
from numpy import ndarray
from pxr import Gf, Usd, UsdGeom, UsdValidation
from scipy.spatial.transform import Rotation

NUMBERS = {pygltflib.FLOAT: np.float32, pygltflib.UNSIGNED_INT: np.uint32}
COLUMNS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


class GltfScene:
    """A ``.glb``: its mesh at a key of its animation, seen by its camera (glTF 2.0, Sec. 3.5, 3.7, 3.10 and 3.11)."""

    def __init__(self, path: Path) -> None:
        self.tree = pygltflib.GLTF2().load(str(path))
        self._content = self.tree.binary_blob()

    def array(self, accessor: int) -> ndarray:
        own = self.tree.accessors[accessor]
        view = self.tree.bufferViews[own.bufferView]
        count, dtype = own.count * COLUMNS[own.type], NUMBERS[own.componentType]
        start = (view.byteOffset or 0) + (own.byteOffset or 0)
        return np.frombuffer(self._content, dtype, count, start).reshape(own.count, -1)

    def animated(self, node: int, path: str, key: int) -> ndarray | None:
        for animation in self.tree.animations:
            for channel in animation.channels:
                if (channel.target.node, channel.target.path) == (node, path):
                    sampler = animation.samplers[channel.sampler]
                    n_keys = self.tree.accessors[sampler.input].count
                    return self.array(sampler.output).reshape(n_keys, -1)[key]
        return None

    def matrix(self, node: int, key: int) -> ndarray:
        """World from node."""
        own = self.tree.nodes[node]
        local = np.eye(4) if own.matrix is None else np.reshape(own.matrix, (4, 4), order="F")
        turn, place, size = (self.animated(node, path, key) for path in ("rotation", "translation", "scale"))
        if turn is not None:
            local[:3, :3] = Rotation.from_quat(turn).as_matrix()
        if size is not None:
            local[:3, :3] *= size
        if place is not None:
            local[:3, 3] = place
        parent = next((i for i, other in enumerate(self.tree.nodes) if node in (other.children or ())), None)
        return local if parent is None else self.matrix(parent, key) @ local

    def points(self, key: int = 0) -> ndarray:
        """The points of the mesh at a key, in the scene."""
        node = next(index for index, own in enumerate(self.tree.nodes) if own.mesh is not None)
        (primitive,) = self.tree.meshes[self.tree.nodes[node].mesh].primitives
        points = self.array(primitive.attributes.POSITION).astype(np.float64)
        weights = self.animated(node, "weights", key)
        for target, weight in zip(primitive.targets or (), () if weights is None else weights, strict=True):
            points += weight * self.array(target["POSITION"])
        return np.column_stack([points, np.ones(len(points))]) @ self.matrix(node, key)[:3].T

    def pixels(self, size_px: tuple[int, int], key: int = 0) -> ndarray:
        node = next(index for index, own in enumerate(self.tree.nodes) if own.camera is not None)
        camera = self.tree.cameras[self.tree.nodes[node].camera]
        points = self.points(key)
        x, y, z = (np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(self.matrix(node, key)).T)[:, :3].T
        if camera.type == "perspective":
            half = np.tan(camera.perspective.yfov / 2)
            right, up = x / -z / half / camera.perspective.aspectRatio, y / -z / half
        else:
            right, up = x / camera.orthographic.xmag, y / camera.orthographic.ymag
            assert (z > -camera.orthographic.zfar).all()
        assert (z < 0).all()  # in front
        return np.column_stack([(right + 1) / 2 * size_px[1], (1 - up) / 2 * size_px[0]])


def usd_pixels(path: Path, size_px: tuple[int, int], time: float | None = None) -> ndarray:
    """Pixels of the only mesh of a stage in its only camera, by the frustum of USD's own library."""
    stage = Usd.Stage.Open(str(path))
    when = Usd.TimeCode.Default() if time is None else Usd.TimeCode(time)
    (mesh,) = (UsdGeom.Mesh(own) for own in stage.Traverse() if own.IsA(UsdGeom.Mesh))
    (camera,) = (UsdGeom.Camera(own) for own in stage.Traverse() if own.IsA(UsdGeom.Camera))
    points = np.array(mesh.GetPointsAttr().Get(when), dtype=np.float64)
    world = np.array(mesh.ComputeLocalToWorldTransform(when))
    frustum: Gf.Frustum = camera.GetCamera(when).frustum
    clip = np.array(frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix())
    x, y, z, w = (np.column_stack([points, np.ones(len(points))]) @ world @ clip).T
    assert (np.abs(z) < w).all()  # between the clipping planes
    return np.column_stack([(x / w + 1) / 2 * size_px[1], (1 - y / w) / 2 * size_px[0]])


def usd_complaints(path: Path) -> list[str]:
    """What usdchecker says of a stage: all validators that come with USD."""
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    found = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(path)))
    return [own.GetMessage() for own in found]
