"""Contact sheets: one sample a row, a picture for each layer."""

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, UInt8
from numpy import ndarray
from PIL import Image, ImageDraw, ImageFont

from datagen.inspection.layer_pictures import GREY, LEGENDS, layer_picture, layer_title
from pix2face.errors import UsageError
from pix2face.files.images import decode_image
from pix2face.shards.layers import LANDMARKS, LAYERS, SEEN
from pix2face.shards.sample import MASK, Sample
from pix2face.shards.shard_reader import ShardHeader, ShardReader, shard_paths

TILE_PX, HEADING_PX = 180, 40
# All layers of such a sample, painted, take a gigabyte and some seconds.
LARGEST_SHOWN_PX = 1 << 24
VISIBLE_COLOUR, HIDDEN_COLOUR = (60, 255, 60), (255, 80, 80)


def contact_sheet(shards: Path, n: int) -> UInt8[ndarray, "h w 3"]:
    """Draws n samples, evenly spread over a folder of shards, in two columns below the headings of their tiles.

    Raises:
        UsageError: There are no shards, or no samples in them.
    """
    tiled = [sample_tiles(sample, header.layers) for header, sample in spread_samples(shards, n)]
    heading = _heading([(title, legend) for title, legend, _ in tiled[0]])
    rows = [np.hstack([picture for _, _, picture in tiles]) for tiles in tiled]
    if len(rows) % 2:
        rows.append(np.full_like(rows[0], 255))
    half = len(rows) // 2
    return np.hstack([np.vstack([heading, *rows[:half]]), np.vstack([heading, *rows[half:]])])


def sample_tiles(sample: Sample, layers: tuple[str, ...]) -> list[tuple[str, str, UInt8[ndarray, "t t 3"]]]:
    """Draws one sample: picture, PNCC over the picture, the other layers of its set, landmarks.

    Returns:
        Title, legend and picture of each tile; the tiles of all samples of a set are the same.
    """
    image = sample_picture(sample)
    tiles = [] if sample.image_bytes is None else [("picture", "", image)]
    if "pncc" in layers:
        pncc, mask = layer_picture("pncc", sample.layers), sample.layers.get("mask")
        blend = (0.45 * image + 0.55 * pncc).astype(np.uint8)
        shown = pncc if mask is None else np.where(mask[..., None], blend, image)
        tiles.append(("PNCC over the picture" if sample.image_bytes else "PNCC", LEGENDS["pncc"], shown))
    # PNCC already shows the mask.
    others = [name for name in LAYERS if name in layers and name not in ("pncc", "mask" if "pncc" in layers else "")]
    tiles += [(layer_title(name), LEGENDS[name], layer_picture(name, sample.layers)) for name in others]
    if LANDMARKS in layers:
        tiles.append(("landmarks", landmark_legend(sample.layers), _with_landmarks(image, sample)))
    return [(title, legend, _tile(picture)) for title, legend, picture in tiles]


def landmark_legend(layers: Collection[str]) -> str:
    """What the colours of landmarks mean: without the layer ``seen`` nobody knows what is in front of the head."""
    return "green: visible, red: hidden" if SEEN in layers else "red: hidden by the head"


def landmarks_in_sight(sample: Sample) -> Bool[ndarray, " m"]:
    """Which landmarks neither the head hides nor, as far as the layer ``seen`` says it, something in front of it."""
    return sample.seen_landmarks if {MASK, SEEN} <= sample.layers.keys() else sample.visible


def sample_picture(sample: Sample) -> UInt8[ndarray, "h w 3"]:
    """The picture of a sample; grey if it has none.

    Raises:
        InputFileError: It cannot be decoded.
    """
    if sample.image_bytes is not None:
        return decode_image(sample.image_bytes, sample.sample_id)
    height, width = next((values.shape[:2] for values in sample.layers.values()), (TILE_PX, TILE_PX))
    return np.full((height, width, 3), GREY, dtype=np.uint8)


def scaled(
    picture: UInt8[ndarray, "h w c"], longer_side_px: int, method: int = cv2.INTER_AREA
) -> UInt8[ndarray, "..."]:
    """Scales a picture to a length of its longer side, by one of OpenCV's methods of interpolation."""
    scale = longer_side_px / max(picture.shape[:2])
    size = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
    return cv2.resize(picture, size, interpolation=method)


def spread_samples(shards: Path, n: int) -> Iterator[tuple[ShardHeader, Sample]]:
    """Reads n samples one by one, evenly spread over a folder of shards.

    Raises:
        UsageError: There are no shards, no samples in them, or samples too large to be shown.
    """
    paths = shard_paths(shards)
    starts = np.cumsum([0, *(len(ShardReader(path)) for path in paths)])
    total = int(starts[-1])
    if not total:
        raise UsageError(f"{shards}: expected samples to show, found empty shards; see rejected.jsonl for the reasons")
    positions = np.unique(np.linspace(0, total - 1, min(n, total)).astype(int))
    which = np.searchsorted(starts, positions, side="right") - 1
    for shard in np.unique(which):
        reader = ShardReader(paths[shard])
        for position in positions[which == shard]:
            height, width = reader.size_px(int(position - starts[shard]))
            if height * width > LARGEST_SHOWN_PX:
                raise UsageError(
                    f"{reader.path}: expected samples of at most {LARGEST_SHOWN_PX >> 20} megapixels to show, found "
                    f"one of {width} x {height} pixels; render some faces smaller to look at them"
                )
            yield reader.header, reader.read(int(position - starts[shard]))


def _heading(titles: Sequence[tuple[str, str]]) -> UInt8[ndarray, "h w 3"]:
    """Titles and legends over a row of tiles."""
    heading = Image.new("RGB", (TILE_PX * len(titles), HEADING_PX), "white")
    draw = ImageDraw.Draw(heading)
    for place, (title, legend) in enumerate(titles):
        draw.text((TILE_PX * place + 4, 3), title, "black", ImageFont.load_default(14))
        draw.text((TILE_PX * place + 4, 21), legend, "#505050", ImageFont.load_default(11))
    return np.asarray(heading)


def _with_landmarks(image: UInt8[ndarray, "h w 3"], sample: Sample) -> UInt8[ndarray, "h w 3"]:
    picture = image.copy()
    radius = max(1, image.shape[0] // 150)
    for (x, y), visible in zip(sample.landmarks2d, landmarks_in_sight(sample), strict=True):
        if abs(x) < 1e4 and abs(y) < 1e4:
            centre = (int(np.floor(x)), int(np.floor(y)))
            cv2.circle(picture, centre, radius, VISIBLE_COLOUR if visible else HIDDEN_COLOUR, -1, cv2.LINE_AA)
    return picture


def _tile(picture: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "t t 3"]:
    shown = scaled(picture, TILE_PX)
    tile = np.full((TILE_PX, TILE_PX, 3), 255, dtype=np.uint8)
    tile[: shown.shape[0], : shown.shape[1]] = shown
    return tile
