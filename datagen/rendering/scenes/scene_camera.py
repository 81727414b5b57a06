"""The camera of a scene as the shaders need it."""

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from datagen.appearance.scene import Scene, UniformValue
from datagen.rendering.clip_space import clip_transform
from pix2face.geometry.camera import Camera
from pix2face.models.rasterise import handedness

NEAR_PLANE_MM = 10.0  # of pinholes: what is nearer is cut off
# Two surfaces in a pixel are told apart where their depths differ by this, mm and pixels.
EDGE_MM, EDGE_PX = 3.0, 3.0


def view_scene(scene: Scene, camera: Camera, height: int, width: int) -> dict[str, UniformValue]:
    """What shaders need to know of the camera's view of a scene, by the uniform's name.

    Everything before the camera lies within the range of depth.

    Raises:
        DegenerateGeometryError: The camera flattens space.
    """
    outside = -float(handedness(camera))
    clip = clip_transform(camera, *depth_range(scene, camera), height, width)
    rows = camera.matrix
    forward = rows[2, :3] / np.linalg.norm(rows[2, :3])
    # Pixels per mm across, where w is 1: the root of the area that a square mm takes.
    across = [row - (row @ forward) * forward for row in rows[:2, :3]]
    scale = float(np.sqrt(np.linalg.norm(np.cross(across[0], across[1]))))
    if camera.is_affine:
        place = np.append(-forward, 0.0)
        typical_w = 1.0
    else:
        place = np.append(-np.linalg.solve(rows[[0, 1, 3], :3], rows[[0, 1, 3], 3]), 1.0)
        typical_w = float(np.median(camera.depth(scene.head.vertices)))
    return {
        "camera_place": place,
        "pixel_mm_at_1": 1 / scale,
        "clip_from_model": clip,
        "half_size": (width / 2, height / 2),
        "outside": outside,
        "depth_from_buffer": _depth_from_buffer(camera, clip),
        "edge_mm": EDGE_MM + EDGE_PX * typical_w / scale,
    }


def depth_range(scene: Scene, camera: Camera) -> tuple[float, float]:
    """Nearest depth and extent of everything that is drawn, mm. A pinhole counts only what is before it."""
    parts = [scene.head.vertices, *(mesh.vertices for mesh in scene.meshes if len(mesh.vertices))]
    depths = [camera.depth(points) for points in parts]
    low, high = min(float(depth.min()) for depth in depths), max(float(depth.max()) for depth in depths)
    if not camera.is_affine:
        low = max(low, NEAR_PLANE_MM)
    return low, max(high - low, 1.0)


def _depth_from_buffer(camera: Camera, clip: Float64[ndarray, "4 4"]) -> tuple[float, float, float, float]:
    """x, y, z, w so that depth in mm is (x d + y) / (z d + w), d in 0..1 as the buffer holds it."""
    row = camera.matrix[2]
    # The third clip coordinate is a depth + b; w is 1 or the depth.
    a = float(clip[2, :3] @ row[:3] / (row[:3] @ row[:3]))
    b = float(clip[2, 3] - a * row[3])
    if camera.is_affine:
        return 2.0, -1.0 - b, 0.0, a  # 2 d - 1 = a depth + b
    return 0.0, b, 2.0, -1.0 - a  # 2 d - 1 = a + b / depth
