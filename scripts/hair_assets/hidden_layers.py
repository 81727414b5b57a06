"""Leaves out quads that hardly add to any view of a hairdo: under several layers of strands they cost time alone."""

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from pix2face.camera import WeakPerspective, weak_perspective_camera
from pix2face.rasterise import Fragments, interpolate, rasterise
from scripts.hair_assets.proxies import BaseHead, Proxy

# Directions that the head is seen from: yaw and pitch, degrees.
VIEWS = [(yaw, pitch) for pitch in (-30, 5, 40) for yaw in range(0, 360, 45)]
SIZE_PX, PX_PER_MM = 160, 0.52
LAYERS = 5
# A quad stays if in some view it adds this share of a pixel's colour to its own pixels, and as many pixels in sum.
SHARE, PIXELS = 0.25, 0.7
# A quad that falls between the pixels stays, mm^2.
TINY_MM2 = 5.0


class HiddenLayers:
    """Finds what hair hides of itself, and what the head hides of it.

    Args:
        base: The head.
    """

    def __init__(self, base: BaseHead) -> None:
        self._cameras = [_camera(yaw, pitch) for yaw, pitch in VIEWS]
        self._head = [rasterise(camera, base.head, base.triangles, SIZE_PX, SIZE_PX).depth for camera in self._cameras]

    def without(self, proxy: Proxy) -> Proxy:
        """The proxy without the quads that add too little."""
        kept = np.zeros(len(proxy.quads), dtype=bool)
        for camera, head_depth in zip(self._cameras, self._head, strict=True):
            added, own = _added(proxy, camera, head_depth)
            kept |= (added >= PIXELS) & (added >= SHARE * own)
        corners = proxy.points[proxy.quads]
        area = np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1) / 2
        kept |= area < TINY_MM2
        return Proxy(proxy.name, proxy.points, proxy.quads[kept], proxy.uv, proxy.uv_quads[kept], proxy.texture)


def _added(proxy: Proxy, camera: ndarray, head_depth: ndarray) -> tuple[ndarray, ndarray]:
    """How many pixels each quad adds to a view, and how many it would if nothing lay before it."""
    pairs, places = np.unique(
        np.stack([proxy.quads, proxy.uv_quads], axis=2).reshape(-1, 2), axis=0, return_inverse=True
    )
    quads = places.reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int32)
    vertices, uv = proxy.points[pairs[:, 0]], proxy.uv[pairs[:, 1]]
    remaining = np.arange(len(triangles))
    open_share = np.ones((SIZE_PX, SIZE_PX))
    added, own = np.zeros((2, len(proxy.quads)))
    for _ in range(LAYERS):
        if not len(remaining):
            break
        fragments = rasterise(camera, vertices, triangles[remaining], SIZE_PX, SIZE_PX)
        hit = (fragments.triangle >= 0) & (fragments.depth < head_depth)
        alpha = _alpha(proxy, fragments, uv, triangles[remaining], hit)
        quad = remaining[fragments.triangle[hit]] % len(proxy.quads)
        np.add.at(added, quad, (open_share[hit] * alpha))
        np.add.at(own, quad, alpha)
        open_share[hit] *= 1 - alpha
        remaining = np.delete(remaining, np.unique(fragments.triangle[fragments.triangle >= 0]))
    return added, own


def _alpha(proxy: Proxy, fragments: Fragments, uv: ndarray, triangles: ndarray, hit: ndarray) -> ndarray:
    places = interpolate(fragments, uv, triangles)[hit]
    height, width = proxy.texture.shape[:2]
    rows = np.clip((places[:, 1] * height).astype(int), 0, height - 1)
    columns = np.clip((places[:, 0] * width).astype(int), 0, width - 1)
    return proxy.texture[rows, columns, 3]


def _camera(yaw: float, pitch: float) -> ndarray:
    turn = Rotation.from_euler("XY", [pitch, yaw], degrees=True).as_matrix() * np.array([[1.0], [-1.0], [-1.0]])
    shift = np.array([SIZE_PX / 2, SIZE_PX / 2 + 20 * PX_PER_MM])
    return weak_perspective_camera(WeakPerspective(PX_PER_MM, turn, shift)).matrix
