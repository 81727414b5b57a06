"""Cuts the head out of the skin textures and divides each by its mean colour."""

import json
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float64, UInt8
from numpy import ndarray
from scipy import ndimage

from datagen.appearance.skin.skin_textures import ATLAS_PX, ATLAS_UV, LARGEST_RATIO, SKINS
from pix2face.models.morphable_model import MorphableModel
from scripts.skin_assets.places import places

# The skins have painted light and shadow, which the renderer adds itself. In the face, half of the variation at larger
# scales is removed; beside it, where some skins have painted hair, all of it.
SHADING_PX, SHADING_KEPT = 14.0, 0.5
HAIR_PX = 4.0
OUTSIDE_REGIONS = ("skin", "brows", "lips", "ears", "scalp", "neck")


def pack_skins(folder: Path, model: MorphableModel) -> UInt8[ndarray, "n h w 3"]:
    """Packs all skins, in the order of ``SKINS``.

    Raises:
        SystemExit: A picture is missing or has another size than expected.
    """
    head, face = (_raster(model, regions) for regions in (OUTSIDE_REGIONS, ("skin",)))
    place = places(model, ("skin", "brows", "lips"), ATLAS_UV, ATLAS_PX)
    beside = (place[..., 1] > 62) | (place[..., 2] < 30) | (np.abs(place[..., 0]) > 66) | ~face
    lips = (np.hypot(place[..., 0] / 30, (place[..., 1] + 44) / 20) < 1) | (np.abs(place[..., 1] - 27) < 15)
    core = ndimage.gaussian_filter((~beside | (lips & (place[..., 2] > 40))).astype(np.float64), 5.0)[..., None]
    return np.stack([_pack(_read(folder / name), head, face, core) for name in SKINS])


def _read(folder: Path) -> Float64[ndarray, "h w 3"]:
    """Reads the head of one skin, in linear RGB."""
    material = json.loads((folder / f"{folder.name}.json").read_text(encoding="utf-8"))
    path = folder / material["mapDiffuse"]
    picture = cv2.imread(str(path))
    if picture is None or picture.shape != (512, 512, 3):
        raise SystemExit(f"{path}: expected a picture of 512 x 512 pixels, found {getattr(picture, 'shape', None)}")
    left, top = round(ATLAS_UV[0] * 512), round((1 - ATLAS_UV[3]) * 512)
    crop = picture[top : top + ATLAS_PX[0], left : left + ATLAS_PX[1], ::-1] / 255.0
    return np.where(crop <= 0.04045, crop / 12.92, ((crop + 0.055) / 1.055) ** 2.4)


def _pack(
    skin: Float64[ndarray, "h w 3"],
    head: Bool[ndarray, "h w"],
    face: Bool[ndarray, "h w"],
    core: Float64[ndarray, "h w 1"],
) -> UInt8[ndarray, "h w 3"]:
    nearest = ndimage.distance_transform_edt(~head, return_distances=False, return_indices=True)
    logarithm = np.log(np.maximum(skin[nearest[0], nearest[1]], 1e-3))
    logarithm -= np.median(logarithm[face], axis=0)
    wide, narrow = (ndimage.gaussian_filter(logarithm, (size, size, 0)) for size in (SHADING_PX, HAIR_PX))
    flat = logarithm - narrow
    logarithm = core * (logarithm - (1 - SHADING_KEPT) * wide) + 0.5 * (1 - core) * flat
    logarithm -= np.median(logarithm[face], axis=0)
    code = 255 * np.sqrt(np.exp(logarithm) / LARGEST_RATIO) + 0.5
    return np.asarray(np.clip(code, 0, 255), dtype=np.uint8)


def _raster(model: MorphableModel, regions: tuple[str, ...]) -> Bool[ndarray, "h w"]:
    """Returns a mask of the texels of some regions of the model."""
    wanted = model.triangles_of(*regions)
    assert model.uv is not None
    assert model.uv_triangles is not None
    corners = model.uv[model.uv_triangles[wanted]]
    inside = (corners > [ATLAS_UV[0], ATLAS_UV[2]]).all(axis=(1, 2)) & (corners[..., 1] < ATLAS_UV[3]).all(axis=1)
    left, top = round(ATLAS_UV[0] * 512), round((1 - ATLAS_UV[3]) * 512)
    columns, rows = corners[inside, :, 0] * 512 - left, (1 - corners[inside, :, 1]) * 512 - top
    mask = np.zeros(ATLAS_PX, dtype=np.uint8)
    for triangle in np.stack([columns, rows], axis=-1):
        cv2.fillConvexPoly(mask, np.floor(triangle).astype(np.int32), 1)
    return mask.astype(bool)
