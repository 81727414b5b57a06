"""Weights of a head's vertices for lips, lids, ears, flush, oil, beard and hair line.

They change smoothly over a few millimetres, unlike the model's regions, whose borders follow edges of the mesh.
"""

from typing import final

import numpy as np
from jaxtyping import Bool, Float, Float32, Int64
from numpy import ndarray
from scipy.spatial import cKDTree

from datagen.appearance.scene import Surface
from pix2face.models.morphable_model import MorphableModel

LID_REACH_MM, HAIRLINE_REACH_MM, CAVITY_RADIUS_MM = 24.0, 48.0, 7.0
# Angles around the head (radians, from 0 at the forehead to pi at the nape), and the height of the hair line (mm).
HAIRLINE = np.array(
    [
        [0.0, 0.3, 0.5, 0.68, 0.85, 1.0, 1.12, 1.22, 1.32, 1.5, 1.7, 2.0, 2.4, np.pi],
        [98.0, 96.0, 92.0, 84.0, 62.0, 40.0, 18.0, 2.0, -4.0, -2.0, -6.0, -28.0, -46.0, -56.0],
    ]
)
HEAD_RADIUS_MM = 78.0


@final
class LidMargins:
    """The vertices at the edges of the lids of each eye (the subject's left eye first).

    Args:
        model: Model with texture coordinates, in which the eye sockets are separate islands.
    """

    def __init__(self, model: MorphableModel) -> None:
        is_socket = _is_socket(model)
        skin = model.triangles_of("skin", "brows")
        ring = np.intersect1d(model.triangles[skin & ~is_socket], model.triangles[is_socket])
        self.sides: tuple[Int64[ndarray, " _"], ...] = tuple(
            ring[sign * model.mean[ring, 0] > 0].astype(np.int64) for sign in (1, -1)
        )
        across = [model.mean[ring, 0] for ring in self.sides]
        self.corners = tuple((ring[x.argmin()], ring[x.argmax()]) for ring, x in zip(self.sides, across, strict=True))
        self.is_upper = tuple(
            model.mean[ring, 1] > np.interp(model.mean[ring, 0], *model.mean[list(ends)][:, :2].T)
            for ring, ends in zip(self.sides, self.corners, strict=True)
        )

    def arches(self, vertices: Float[ndarray, "v 3"]) -> tuple[Float32[ndarray, "2 4"], Float32[ndarray, "2 4"]]:
        """Fits parabolas to the opening of each eye of a head, seen from the front.

        Returns:
            Frames: midpoint of the corners (x, y), half of their distance along x, slope of the line through them.
            Arches: height and skew of the upper lid over that line, then of the lower lid. A lid is at
            (1 - t^2) (height + skew t), with t from -1 at the smaller x to 1 at the larger.
        """
        frames, arches = np.zeros((2, 2, 4), dtype=np.float32)
        for k, (ring, ends, is_upper) in enumerate(zip(self.sides, self.corners, self.is_upper, strict=True)):
            low, high = vertices[list(ends), :2].astype(np.float64)
            middle, half = (low + high) / 2, max((high[0] - low[0]) / 2, 1.0)
            slope = (high[1] - low[1]) / (2 * half)
            t = (vertices[ring, 0] - middle[0]) / half
            height = vertices[ring, 1] - middle[1] - slope * half * t
            open_by = np.maximum(1 - t**2, 0)
            design = np.stack([open_by, open_by * t], axis=1)
            frames[k] = [*middle, half, slope]
            lids = [np.linalg.lstsq(design[lid], height[lid], rcond=None)[0] for lid in (is_upper, ~is_upper)]
            arches[k] = np.concatenate(lids)
        return frames, arches


def head_paint(model: MorphableModel) -> Float32[ndarray, "v 8"]:
    """Computes the weights of the vertices for `skin.glsl`.

    Returns:
        Lips; distance from the nearest edge of a lid (1 is 24 mm and more); ears; cavities (0 is flat or convex, 1
        deep); flush; oil; beard; hair line (0.5 on the line, 1 from 24 mm inside the hair).
    """
    surface = Surface(model)
    mean = model.mean
    lips = _inwards(model, _smoothed(model, _weight(surface, "lips")))
    ear = _smoothed(model, _smoothed(model, _weight(surface, "ears")))
    margins = np.concatenate(LidMargins(model).sides)
    lid = np.clip(cKDTree(mean[margins]).query(mean)[0] / LID_REACH_MM, 0, 1)
    cavity = _smoothed(model, _cavity(mean, surface.normals(mean)))
    hair = np.clip(0.5 + _inside_hairline(mean) / HAIRLINE_REACH_MM, 0, 1) * (1 - ear)
    channels = [lips, lid, ear, cavity, _flush(mean, ear), _oil(mean), _beard(mean) * (1 - lips) * (1 - ear), hair]
    paint = np.stack(channels, axis=1).astype(np.float32)
    return paint if model.symmetry is None else (paint + paint[model.symmetry]) / 2


def _is_socket(model: MorphableModel) -> Bool[ndarray, " t"]:
    assert model.uv is not None
    assert model.uv_triangles is not None
    return np.asarray((model.uv[model.uv_triangles][..., 0] < 0.2).all(axis=1))


def _weight(surface: Surface, region: str) -> Float32[ndarray, " v"]:
    return np.asarray(surface.region_weights[:, surface.region_names.index(region)])


def _smoothed(model: MorphableModel, values: ndarray) -> ndarray:
    """Replaces the value of each vertex by the mean over its triangles."""
    of_triangle = values[model.triangles].mean(axis=1)
    total, count = np.zeros((2, len(values)))
    np.add.at(total, model.triangles.reshape(-1), np.repeat(of_triangle, 3))
    np.add.at(count, model.triangles.reshape(-1), 1.0)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), values))


def _inwards(model: MorphableModel, lips: ndarray) -> ndarray:
    """Extends the lips by some millimetres into the mouth."""
    inside = model.vertices_of("mouth_inside")
    distance = cKDTree(model.mean[model.vertices_of("lips")]).query(model.mean[inside])[0]
    lips = lips.copy()
    lips[inside] = np.maximum(lips[inside], np.exp(-distance / 4.0))
    return lips


def _cavity(mean: ndarray, normals: ndarray) -> ndarray:
    """Returns the mean slope by which the surroundings of each vertex rise above it, scaled to 0..1."""
    near = cKDTree(mean).query(mean, k=40, distance_upper_bound=CAVITY_RADIUS_MM)[1]
    is_known = near < len(mean)
    near = np.where(is_known, near, 0)
    away = mean[near] - mean[:, None]
    rise = np.einsum("vkc,vc->vk", away, normals) / np.maximum(np.linalg.norm(away, axis=2), 1e-3)
    use = is_known & (np.einsum("vkc,vc->vk", normals[near], normals) > -0.3)
    return np.asarray(np.clip(2.2 * (rise * use).sum(axis=1) / np.maximum(use.sum(axis=1), 1) - 0.15, 0, 1))


def _inside_hairline(mean: ndarray) -> ndarray:
    """Returns the signed distance (mm) from the hair line, positive in the hair."""
    angle = np.arctan2(np.abs(mean[:, 0]), mean[:, 2])
    height = np.interp(angle, *HAIRLINE)
    slope = (np.interp(angle + 0.02, *HAIRLINE) - np.interp(angle - 0.02, *HAIRLINE)) / (0.04 * HEAD_RADIUS_MM)
    return np.asarray((mean[:, 1] - height) / np.sqrt(1 + slope**2))


def _flush(mean: ndarray, ear: ndarray) -> ndarray:
    x, y, z = np.abs(mean[:, 0]), mean[:, 1], mean[:, 2]
    cheek = np.exp(-(((x - 43) / 19) ** 2) - ((y + 10) / 15) ** 2) * (z > 10)
    nose = np.exp(-((x / 13) ** 2) - ((y + 10) / 15) ** 2) * _sigmoid(z, 100, 6)
    chin = 0.4 * np.exp(-((x / 14) ** 2) - ((y + 72) / 10) ** 2) * (z > 40)
    return np.asarray(np.clip(cheek + nose + chin + 0.7 * ear, 0, 1))


def _oil(mean: ndarray) -> ndarray:
    x, y, z = np.abs(mean[:, 0]), mean[:, 1], mean[:, 2]
    forehead = np.exp(-((x / 32) ** 2) - ((y - 76) / 20) ** 2)
    nose = np.exp(-((x / 11) ** 2) - ((y - 2) / 28) ** 2)
    cheek = 0.7 * np.exp(-(((x - 36) / 14) ** 2) - ((y + 4) / 13) ** 2)
    chin = 0.7 * np.exp(-((x / 13) ** 2) - ((y + 72) / 11) ** 2)
    return np.asarray(np.clip(forehead + nose + cheek + chin, 0, 1) * (z > 0))


def _beard(mean: ndarray) -> ndarray:
    """Weights of the beard: cheeks below a line from the ear to the mouth, upper lip, chin, and below the chin."""
    x, y, z = np.abs(mean[:, 0]), mean[:, 1], mean[:, 2]
    line = np.where(x > 27, -34 + 0.85 * (x - 27), -25 - 9 * _sigmoid(x, 24, 2))
    within = _sigmoid(line - y, 0, 2.5)
    throat = _sigmoid(y + 96 + 0.35 * np.maximum(40 - z, 0), 0, 4)
    return np.asarray(within * throat * _sigmoid(z, 6, 5))


def _sigmoid(value: ndarray, middle: float, width: float) -> ndarray:
    return np.asarray(1 / (1 + np.exp(-np.clip((value - middle) / width, -30, 30))))
