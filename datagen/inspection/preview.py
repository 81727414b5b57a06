"""Contact sheets: people would rather look than read."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from datagen.inspection.layer_pictures import GREY, layer_picture
from pix2face.errors import UsageError
from pix2face.files.images import decode_image
from pix2face.shards.layers import LANDMARKS, LAYERS
from pix2face.shards.shard_reader import ShardHeader, ShardReader, Triplet, shard_paths

TILE_PX = 180
VISIBLE_COLOUR, HIDDEN_COLOUR = (60, 255, 60), (255, 80, 80)


def contact_sheet(shards: Path, n: int) -> UInt8[ndarray, "h w 3"]:
    """Draws n samples, evenly spread over a folder of shards, one a row, two rows side by side.

    Raises:
        UsageError: There are no shards, or no samples in them.
    """
    rows = [sample_strip(triplet, header.layers) for header, triplet in spread_triplets(shards, n)]
    if len(rows) % 2:
        rows.append(np.full_like(rows[0], 255))
    half = len(rows) // 2
    return np.hstack([np.vstack(rows[:half]), np.vstack(rows[half:])])


def sample_strip(triplet: Triplet, layers: tuple[str, ...]) -> UInt8[ndarray, "h w 3"]:
    """One sample: picture, PNCC over the picture, the other layers, landmarks (green: visible, red: hidden).

    Args:
        triplet: The sample.
        layers: What the set has; every sample gets the same tiles.
    """
    image = sample_picture(triplet)
    tiles = [] if triplet.image is None else [image]
    if "pncc" in layers:
        pncc, mask = layer_picture("pncc", triplet.layers), triplet.layers.get("mask")
        blend = (0.45 * image + 0.55 * pncc).astype(np.uint8)
        tiles.append(pncc if mask is None else np.where(mask[..., None], blend, image))
    # PNCC shows the mask already.
    others = [name for name in LAYERS if name in layers and name not in ("pncc", "mask" if "pncc" in layers else "")]
    tiles += [layer_picture(name, triplet.layers) for name in others]
    if LANDMARKS in layers:
        tiles.append(_with_landmarks(image, triplet))
    return np.hstack([_tile(tile) for tile in tiles])


def sample_picture(triplet: Triplet) -> UInt8[ndarray, "h w 3"]:
    """The picture of a sample; grey where it has none.

    Raises:
        InputFileError: It cannot be decoded.
    """
    if triplet.image is not None:
        return decode_image(triplet.image, triplet.sample_id)
    height, width = next((values.shape[:2] for values in triplet.layers.values()), (TILE_PX, TILE_PX))
    return np.full((height, width, 3), GREY, dtype=np.uint8)


def spread_triplets(shards: Path, n: int) -> Iterator[tuple[ShardHeader, Triplet]]:
    """Reads n samples, evenly spread over a folder of shards, one after the other.

    Raises:
        UsageError: There are no shards, or no samples in them.
    """
    paths, lengths = shard_paths(shards), []
    for path in paths:
        with ShardReader(path) as reader:
            lengths.append(len(reader))
    starts = np.concatenate([[0], np.cumsum(lengths)])
    total = int(starts[-1])
    if not total:
        raise UsageError(f"{shards}: expected samples to show, found empty shards; see rejected.jsonl for the reasons")
    positions = np.unique(np.linspace(0, total - 1, min(n, total)).astype(int))
    which = np.searchsorted(starts, positions, side="right") - 1
    for shard in np.unique(which):
        with ShardReader(paths[shard]) as reader:
            for position in positions[which == shard]:
                yield reader.header, reader.triplet(int(position - starts[shard]))


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
