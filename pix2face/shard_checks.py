"""Checks of shards that were written some time ago: what a full reading can tell."""

from pathlib import Path

import numpy as np

from pix2face.errors import InputFileError
from pix2face.images import decode_image
from pix2face.layers import LAYERS, WHOLE_HEAD_LAYERS
from pix2face.shards import ShardReader, Triplet


def verify_shard(path: Path) -> list[str]:
    """Reads every sample of a shard and checks it.

    Returns:
        What is wrong with it, in words; empty where nothing is.
    """
    problems = []
    try:
        with ShardReader(path) as reader:
            if len(set(reader.sample_ids)) < len(reader):
                problems.append("sample ids are not unique")
            for index in range(len(reader)):
                problems += [f"sample {reader.sample_ids[index]!r}: {text}" for text in _sample_problems(reader, index)]
    except InputFileError as error:
        problems.append(str(error))
    return problems


def _sample_problems(reader: ShardReader, index: int) -> list[str]:
    triplet, problems = reader.triplet(index), []
    sizes = {array.shape[:2] for array in triplet.layers.values()}
    if triplet.image is not None:
        sizes.add(decode_image(triplet.image, f"{reader.path}, sample {index}").shape[:2])
    if len(sizes) > 1:
        problems.append(f"the picture and its layers are of different sizes: {sorted(sizes)}")
    if "mask" in triplet.layers:
        problems += _mask_problems(triplet)
    limit = reader.header.pncc_limit_mm + 0.01
    if "pncc" in triplet.layers and not np.abs(triplet.layers["pncc"]).max(initial=0) <= limit:
        problems.append(f"PNCC exceeds the model's {reader.header.pncc_limit_mm:.1f} mm")
    stored, found = reader.checksum_pair(index)
    if stored != found:
        problems.append("the checksum differs: the content has changed since it was written")
    arrays = ("identity", "expression", "landmarks2d", "landmarks3d")
    return problems + [f"{name} is not finite" for name in arrays if not np.isfinite(getattr(triplet, name)).all()]


def _mask_problems(triplet: Triplet) -> list[str]:
    mask = triplet.layers["mask"]
    problems = [] if mask.any() else ["the mask is empty"]
    within = [name for name in LAYERS if name in triplet.layers and name not in WHOLE_HEAD_LAYERS]
    return problems + [f"{name} is not 0 outside the mask" for name in within if triplet.layers[name][~mask].any()]
