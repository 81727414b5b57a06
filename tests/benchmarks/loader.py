"""How many training samples a second are loaded, where the time goes, and whether memory stays flat.

    datagen sample --n 300 --size 144 --out f144.h5 && datagen render --coeffs f144.h5 --out s144/
    datagen sample --n 300 --size 256 --out f256.h5 && datagen render --coeffs f256.h5 --out s256/
    python -m tests.benchmarks.loader --shards s144/:128 s256/:256 --out loader.json

For each folder and side of the network's input, on one core: seconds of the processor, so that other work on the
machine counts little. On worker processes (``--workers``): by the clock, so that it counts fully. Every row is loaded
by the same code as in a training. The best of some rounds, each of as many draws as there are samples.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import cv2
import numpy as np
import torch

from pix2face.files.images import decode_image
from pix2face.geometry.jitter import JitterRange, draw_jitter
from pix2face.shards.layers import IMAGE
from tests.benchmarks.measuring import options_parser, write_report
from training.data.batches import batch_row, empty_batch
from training.data.cropping import cut, cut_around_box, resample, vary_colours
from training.data.dataset import DrawDataset, middle_corner
from training.data.decoded_sample import TRAINED_LAYERS, DecodedSample, decode_sample
from training.data.halving import halved
from training.data.loader import DrawLoader
from training.data.shard_index import ShardIndex, index_shards
from training.loop.loss_log import memory_mb
from training.loop.validation import inference_crop
from training.recipe.presets import PRESETS
from training.recipe.recipe import Recipe

BATCH_SIZE = 24
CACHE_BYTES = 2 * 10**9


def rate_of_a_core(shards: ShardIndex, recipe: Recipe, cache_bytes: int, rounds: int) -> dict[str, float]:
    """Samples a second of processor time in this process: of the first pass, and of the best later one."""
    loader = DrawLoader(DrawDataset(shards, recipe, cache_bytes), recipe.batch_size, workers=0)
    n_batches = max(len(shards) // recipe.batch_size, 1)
    batches = loader.batches(0, (rounds + 1) * n_batches)
    rates = []
    for _ in range(rounds + 1):
        began = process_time()
        n = sum(len(batch) for batch in islice(batches, n_batches))
        rates.append(n / (process_time() - began))
    return {"first_pass": round(rates[0]), "later": round(max(rates[1:]))}


def rate_of_workers(shards: ShardIndex, recipe: Recipe, workers: int, rounds: int) -> int:
    """Samples a second by the clock, from worker processes that have started: the best round."""
    loader = DrawLoader(DrawDataset(shards, recipe), recipe.batch_size, workers=workers)
    n_batches = max(len(shards) // recipe.batch_size, 1)
    batches = loader.batches(0, (rounds + 1) * n_batches)
    rates = []
    for _ in range(rounds + 1):
        began = perf_counter()
        n = sum(len(batch) for batch in islice(batches, n_batches))
        rates.append(n / (perf_counter() - began))
    return round(max(rates[1:]))


def stages(shards: ShardIndex, recipe: Recipe, rounds: int) -> dict[str, float]:
    """Milliseconds of processor time that each step takes for a sample."""
    size_px = recipe.size_px
    names = [*(name for name in TRAINED_LAYERS if name in shards.readers[0].header.layers), IMAGE, "landmarks2d"]
    places = [(shards.readers[shard], k) for shard, k in zip(shards.shard, shards.position.tolist(), strict=True)]
    n = len(places)
    began = process_time()
    stored = [reader.stored(k, names, is_checked=True) for reader, k in places]
    first_ms = 1e3 * (process_time() - began) / n
    decoded = [decode_sample(*place, is_checked=False) for place in places]
    ready = [_ready(sample, size_px) for sample in decoded]
    row = batch_row(empty_batch(1, size_px, has_seen=shards.knows_seen), 0)
    jitter = draw_jitter(np.random.default_rng(0), JitterRange())
    steps: dict[str, Callable[[int], object]] = {
        "read, inflate, undo the predictor": lambda k: places[k][0].stored(places[k][1], names),
        "decode the picture": lambda k: decode_image(stored[k][IMAGE], ""),
        "halve (where twice as large or more)": lambda k: halved(decoded[k]),
        "to the cache": lambda k: ready[k].to_bytes(),
        "cut": lambda k: cut(ready[k], middle_corner(ready[k], size_px), row, mirror=False),
        "cut and mirror": lambda k: cut(ready[k], middle_corner(ready[k], size_px), row, mirror=True),
        "resample": lambda k: resample(decoded[k], inference_crop(decoded[k].landmarks2d, recipe), row),
        "vary colours": lambda k: vary_colours(row.image, jitter),
        "cut around the box (box, the first time)": lambda k: cut_around_box(decoded[k], k, size_px, recipe.crop_scale),
        "draw the jitter": lambda k: draw_jitter(np.random.default_rng([1, 0, k]), JitterRange()),
    }
    times = {"read, inflate, undo the predictor; compare the checksum": first_ms}
    for name, step in steps.items():
        times[name] = min(_seconds(step, n) for _ in range(rounds)) * 1e3 / n
    return {name: round(value, 3) for name, value in times.items()}


def memory_of_many_draws(shards: ShardIndex, recipe: Recipe, draws: int) -> dict[str, float]:
    """MB that this process holds after the first pass, and after many draws more; nothing is cached."""
    loader = DrawLoader(DrawDataset(shards, recipe), recipe.batch_size, workers=0)
    n_batches = max(len(shards) // recipe.batch_size, 1)
    total = max(draws // recipe.batch_size, n_batches + 1)
    batches: Iterator[object] = loader.batches(0, total)
    list(_forgotten(islice(batches, n_batches)))
    before = memory_mb()
    list(_forgotten(batches))
    return {"draws": total * recipe.batch_size, "after_a_pass_mb": round(before), "at_the_end_mb": round(memory_mb())}


def measure(text: str, rounds: int, draws: int, workers: int) -> dict[str, Any]:
    """Everything for one folder."""
    folder, _, size = text.rpartition(":")
    shards, size_px = index_shards([Path(folder)]), int(size)
    recipe = replace(PRESETS["cpu"], size_px=size_px, batch_size=BATCH_SIZE, jitter=JitterRange(mirror=True))
    rates: dict[str, Any] = {}
    for cropping in ("none", "shift", "box", "full"):
        own = replace(recipe, cropping=cropping)
        rates[cropping] = {
            "of_a_core_a_second": rate_of_a_core(shards, own, 0, rounds),
            "of_a_core_a_second_from_the_cache": rate_of_a_core(shards, own, CACHE_BYTES, rounds)["later"],
            "by_the_clock": rate_of_workers(shards, own, workers, rounds) if workers else None,
        }
    return {
        "samples": len(shards),
        "size_px": size_px,
        "samples_a_second": rates,
        "ms_of_a_core": stages(shards, recipe, rounds),
        "memory": memory_of_many_draws(shards, replace(recipe, cropping="shift"), draws),
    }


def _ready(sample: DecodedSample, size_px: int) -> DecodedSample:
    """As the loader keeps a sample of which squares are to be cut."""
    while min(sample.image.shape[:2]) >= 2 * size_px:
        sample = halved(sample)
    return sample


def _seconds(step: Callable[[int], object], n: int) -> float:
    began = process_time()
    for k in range(n):
        step(k)
    return process_time() - began


def _forgotten(batches: Iterator[object]) -> Iterator[None]:
    for _ in batches:
        yield None


def main() -> None:
    """Measures every folder and writes the JSON."""
    parser = options_parser(__doc__)
    parser.add_argument("--shards", nargs="+", required=True, metavar="FOLDER:SIZE")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--draws", type=int, default=6000)
    parser.add_argument("--workers", type=int, default=2, help="0 leaves out what they load by the clock")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    folders = {text: measure(text, options.rounds, options.draws, options.workers) for text in options.shards}
    write_report({"folders": folders}, options.out)


if __name__ == "__main__":
    main()
