"""Contact sheets: people would rather look than read."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.face_maps import map_picture
from pix2face.images import decode_image
from pix2face.shards import ShardReader, Triplet, shard_paths

TILE_PX = 180
VISIBLE_COLOUR, HIDDEN_COLOUR = (60, 255, 60), (255, 80, 80)


def contact_sheet(shards: Path, n: int) -> UInt8[ndarray, "h w 3"]:
    """Draws n samples, evenly spread over a folder of shards, one a row, two rows side by side.

    Raises:
        UsageError: There are no shards, or no samples in them.
    """
    rows = [sample_strip(triplet) for triplet in _spread_triplets(shards, n)]
    if not rows:
        raise UsageError(f"{shards}: expected samples to show, found empty shards; see rejected.jsonl for the reasons")
    if len(rows) % 2:
        rows.append(np.full_like(rows[0], 255))
    half = len(rows) // 2
    return np.hstack([np.vstack(rows[:half]), np.vstack(rows[half:])])


def sample_strip(triplet: Triplet) -> UInt8[ndarray, "h w 3"]:
    """One sample: picture, PNCC over the picture, offset, depth, landmarks (green: visible, red: hidden)."""
    image, maps = decode_image(triplet.image or b"", triplet.sample_id), triplet.maps
    pncc = map_picture(maps.pncc, maps.mask, limit_mm=120)
    blend = np.where(maps.mask[..., None], (0.45 * image + 0.55 * pncc).astype(np.uint8), image)
    offset = map_picture(maps.offset, maps.mask, limit_mm=15)
    tiles = [image, blend, offset, _depth_picture(triplet), _with_landmarks(image, triplet)]
    return np.hstack([_tile(tile) for tile in tiles])


def _spread_triplets(shards: Path, n: int) -> list[Triplet]:
    triplets = []
    readers = [ShardReader(path) for path in shard_paths(shards)]
    try:
        starts = np.concatenate([[0], np.cumsum([len(reader) for reader in readers])])
        total = int(starts[-1])
        for position in np.unique(np.linspace(0, total - 1, min(n, total)).astype(int)) if total else ():
            which = int(np.searchsorted(starts, position, side="right")) - 1
            triplets.append(readers[which].triplet(int(position - starts[which])))
    finally:
        for reader in readers:
            reader.close()
    return triplets


def _depth_picture(triplet: Triplet) -> UInt8[ndarray, "h w 3"]:
    mask, depth = triplet.maps.mask, triplet.layers["depth"]
    picture = np.full((*mask.shape, 3), 128, dtype=np.uint8)
    near, far = depth[mask].min(), depth[mask].max()
    shade = 255 * (1 - (depth[mask] - near) / max(float(far - near), 1e-6))
    picture[mask] = shade[:, None].astype(np.uint8)
    return picture


def _with_landmarks(image: UInt8[ndarray, "h w 3"], triplet: Triplet) -> UInt8[ndarray, "h w 3"]:
    picture = image.copy()
    radius = max(1, image.shape[0] // 150)
    for (x, y), visible in zip(triplet.landmarks2d, triplet.visible, strict=True):
        if abs(x) < 1e4 and abs(y) < 1e4:
            centre = (int(np.floor(x)), int(np.floor(y)))
            cv2.circle(picture, centre, radius, VISIBLE_COLOUR if visible else HIDDEN_COLOUR, -1, cv2.LINE_AA)
    return picture


def _tile(picture: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "t t 3"]:
    scale = TILE_PX / max(picture.shape[:2])
    size = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
    tile = np.full((TILE_PX, TILE_PX, 3), 255, dtype=np.uint8)
    tile[: size[1], : size[0]] = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return tile
