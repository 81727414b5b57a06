"""Makes brows as a patch of the head's skin, which follows every expression exactly.

All twelve brows have the same texture coordinates over the patch: u along the brow, v down.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy import ndarray

from scripts.hair_assets.proxies import BaseHead, Proxy
from scripts.hair_assets.textures import as_bytes, baked, normalised

# u is the angle about a vertical axis in the head, v the height. These are their limits for the left brow.
AXIS_Z_MM = 20.0
ANGLES_DEG = (-2.0, 60.0)
HEIGHTS_MM = (24.0, 60.0)
ROWS, COLUMNS = 144, 256
# Margin of the patch around the hair of all brows, so that they can be shifted.
MARGIN_PX = 6
FOREMOST_REGIONS = ("skin", "brows")


@final
@dataclass(frozen=True)
class BrowPatch:
    """The left patch; the right one is its mirror image."""

    vertices: ndarray  # vertices of the model, unordered
    triangles: ndarray  # indices into `vertices`
    uv: ndarray  # texture coordinates of each vertex
    textures: ndarray  # (12, rows, columns, 2) grey and alpha


def build_brow_patch(base: BaseHead, brows: list[Proxy]) -> BrowPatch:
    """Cuts the patch out of the head and bakes the brows to its texture coordinates."""
    textures = np.stack([_bake(brow) for brow in brows])
    uv = brow_places(base.head)
    rows, columns = np.nonzero(textures[..., 1].max(axis=0) > 40)
    low = (np.array([columns.min(), rows.min()]) - MARGIN_PX) / [COLUMNS, ROWS]
    high = (np.array([columns.max(), rows.max()]) + MARGIN_PX) / [COLUMNS, ROWS]
    near = (uv > low).all(axis=1) & (uv < high).all(axis=1) & (base.head[:, 2] > 40) & (base.head[:, 0] > -1e-3)
    chosen = near[base.triangles].any(axis=1) & np.isin(base.regions, FOREMOST_REGIONS)
    chosen &= (base.head[base.triangles][..., 0] > -1e-3).all(axis=1)
    vertices, triangles = np.unique(base.triangles[chosen], return_inverse=True)
    return BrowPatch(vertices, triangles.reshape(-1, 3), uv[vertices], textures)


def brow_places(points: ndarray) -> ndarray:
    """Returns texture coordinates of points near the left brow."""
    angle = np.degrees(np.arctan2(points[:, 0], points[:, 2] - AXIS_Z_MM))
    u = (angle - ANGLES_DEG[0]) / (ANGLES_DEG[1] - ANGLES_DEG[0])
    v = (HEIGHTS_MM[1] - points[:, 1]) / (HEIGHTS_MM[1] - HEIGHTS_MM[0])
    return np.column_stack([u, v])


def _bake(brow: Proxy) -> ndarray:
    picture = baked(brow, brow_places(brow.points), brow.points[:, 0] > 0, (ROWS, COLUMNS))
    alpha = picture[..., 3]
    return as_bytes(normalised(picture[..., :3].mean(axis=2), alpha), alpha)
