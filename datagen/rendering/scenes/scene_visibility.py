"""What each sample of a picture of a scene sees: a triangle of the head, or a kind of opaque object, and its depth."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32, Int32
from numpy import ndarray

from datagen.appearance.scene import SCENE_LABELS, SceneMesh
from datagen.rendering.processor.nearest import Box, draw_nearest
from datagen.rendering.scenes.scene_camera import NEAR_PLANE_MM
from pix2face.geometry.camera import Camera
from pix2face.models.rasterise import handedness


def see_scene(
    head: tuple[Float32[ndarray, "v 3"], Int32[ndarray, "t 3"]],
    objects: Sequence[SceneMesh],
    camera: Camera,
    size: tuple[int, int],
    backs: Box,
) -> Float32[ndarray, "H W 2"]:
    """Finds what the samples of a picture (height, width) see of a head and of opaque objects.

    ``backs`` is the box (px) in which the inside of the head may be seen.

    Returns:
        For each sample the number of the head's triangle from 1 on, an object's label below 0, or 0 for nothing; and
        the depth in mm. The samples are twice as fine as the pixels, and one more: those with odd numbers lie at the
        centres of pixels, and neighbours share the others.
    """
    found = np.zeros((2 * size[0] + 1, 2 * size[1] + 1, 2), dtype=np.float32)
    seen, nearest = found[..., 0], found[..., 1]
    nearest.fill(np.inf)
    left, top, right, bottom = backs
    fine_backs = (2 * left, 2 * top, 2 * right + 1, 2 * bottom + 1) if left < right else backs
    vertices, triangles = head
    front = -float(handedness(camera))
    draw_nearest(_on_samples(vertices, camera), triangles, front, fine_backs, (1.0, 1.0), nearest, seen)
    for mesh in objects:
        points, corners = clip_at_near_plane(mesh.vertices, mesh.triangles, camera)
        label = -float(SCENE_LABELS.index(mesh.label))
        draw_nearest(_on_samples(points, camera), corners, 0.0, fine_backs, (label, 0.0), nearest, seen)
    if not camera.is_affine:
        np.divide(-1, nearest, out=nearest)
    return found


def _on_samples(points: Float32[ndarray, "v 3"], camera: Camera) -> Float32[ndarray, "v 3"]:
    """Column and row in samples, and a number that is linear in the image and larger where a point is farther."""
    rows = camera.matrix.astype(np.float32)
    placed = points @ rows[:3, :3].T + rows[:3, 3]
    if camera.is_affine:
        placed[:, :2] = 2 * placed[:, :2] + np.float32(0.5)
        return placed
    depth = np.where(placed[:, 2] > 0, placed[:, 2], np.nan).astype(np.float32)
    placed[:, :2] = 2 * placed[:, :2] / depth[:, None] + np.float32(0.5)
    placed[:, 2] = -1 / depth
    return placed


def clip_at_near_plane(
    points: Float32[ndarray, "v 3"], triangles: Int32[ndarray, "t 3"], camera: Camera
) -> tuple[Float32[ndarray, "w 3"], Int32[ndarray, "u 3"]]:
    """Cuts off what is nearer to a pinhole than `NEAR_PLANE_MM`."""
    depth = camera.depth(points)
    if camera.is_affine or not len(points) or depth.min() >= NEAR_PLANE_MM:
        return points, triangles
    is_near = depth[triangles] < NEAR_PLANE_MM
    n_near, n = is_near.sum(axis=1), len(points)
    added, parts = [points], [triangles[n_near == 0]]
    for count in (1, 2):
        cut = n_near == count
        # The corner that is alone on its side of the plane comes first.
        alone = (is_near[cut] == (count == 1)).argmax(axis=1)
        a, b, c = (np.take_along_axis(triangles[cut], (alone[:, None] + turn) % 3, axis=1)[:, 0] for turn in range(3))
        for other in (b, c):
            share = ((NEAR_PLANE_MM - depth[a]) / (depth[other] - depth[a])).astype(np.float32)
            added.append(points[a] + share[:, None] * (points[other] - points[a]))
        ab = np.arange(n, n + len(a), dtype=np.int32)
        ac = ab + np.int32(len(a))
        n += 2 * len(a)
        parts += [np.stack([ab, b, c], 1), np.stack([ab, c, ac], 1)] if count == 1 else [np.stack([a, ab, ac], 1)]
    return np.concatenate(added), np.concatenate(parts)
