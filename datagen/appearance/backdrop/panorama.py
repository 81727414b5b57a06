"""What a camera sees of the environments around it."""

import math

import cv2
import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray

from datagen.appearance.light.environments import panorama_place, picture_panorama
from datagen.appearance.light.sources import PanoramaLight, environment_from_camera
from pix2face.geometry.camera import Camera, pinhole_of

# Across a picture of an affine camera, which has no field of view of its own.
AFFINE_VIEW_DEG = 25.0
# Samples for each texel of a panorama: more would show nothing more.
_SAMPLES_PER_TEXEL, _FEWEST_SAMPLES = 1.6, 24


def panorama_view(
    panoramas: tuple[PanoramaLight, ...], camera: Camera, size: tuple[int, int], view_deg: float
) -> Float32[ndarray, "h w 3"]:
    """Linear light from behind, no finer than the panoramas are.

    Args:
        panoramas: Their light is added.
        camera: A pinhole's rays are followed; it is turned as the panoramas say, however the head is turned.
        size: Rows and columns of the picture; the result may be smaller.
        view_deg: Across the picture's width; 0 is the camera's own.
    """
    height, width = size
    focal, x, y = _intrinsics(camera, size, view_deg)
    texels = math.degrees(2 * math.atan(width / 2 / focal)) / 360 * picture_panorama(panoramas[0].name).shape[1]
    n = int(np.clip(_SAMPLES_PER_TEXEL * texels, _FEWEST_SAMPLES, max(width, _FEWEST_SAMPLES)))
    rows, columns = max(2, round(n * height / width)), n
    across = ((np.arange(columns) + 0.5) * width / columns - x) / focal
    down = ((np.arange(rows) + 0.5) * height / rows - y) / focal
    rays = np.ones((rows, columns, 3))
    rays[..., 0], rays[..., 1] = across[None], down[:, None]
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    total = np.zeros((rows, columns, 3), dtype=np.float32)
    for panorama in panoramas:
        seen = look_up(panorama.name, rays @ environment_from_camera(panorama).T)
        total += seen @ np.array(panorama.colour_matrix, dtype=np.float32).T
    return np.maximum(total, 0)


def look_up(name: str, directions: Float64[ndarray, "h w 3"]) -> Float32[ndarray, "h w 3"]:
    """Light of an environment from unit vectors of its frame, between texels linearly, across the seam too."""
    panorama = picture_panorama(name)
    height, width = panorama.shape[:2]
    place = panorama_place(directions, height, width).astype(np.float32)
    np.clip(place[..., 1], 0, height - 1, out=place[..., 1])
    found = cv2.remap(panorama, place[..., 0], place[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return np.asarray(found, dtype=np.float32)


def _intrinsics(camera: Camera, size: tuple[int, int], view_deg: float) -> tuple[float, float, float]:
    """Focal length and principal point in px."""
    height, width = size
    if view_deg <= 0 and not camera.is_affine:
        pinhole = pinhole_of(camera)
        x, y = (float(value) for value in pinhole.principal_point_px)
        return pinhole.focal_px, x, y
    view = math.radians(view_deg if view_deg > 0 else AFFINE_VIEW_DEG)
    return width / 2 / math.tan(view / 2), width / 2, height / 2
