"""Bytes and time of ways to store triplets: python -m tests.benchmarks.storage --shards DIR [DIR ...] --out FILE.

Takes the first samples of each folder of shards (``datagen render``; photographs at 450 px, renders at 256 px) and, in
one run, stores their maps in every way that was considered, stores their pictures in several formats, and writes and
reads shards as the project does. Times are of the processor, for one triplet, and the best of several rounds: HDF5's
own gzip of plain values is the reference that ratios refer to. Reading by two processes at once is timed by the clock
too, which counts only where nothing else runs.
"""

import hashlib
import multiprocessing
import tempfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import cv2
import h5py
import hdf5plugin
import numpy as np
from isal import isal_zlib

from pix2face.shards.layers import DEFAULT_LAYERS
from pix2face.shards.map_storage import predict, undo_prediction
from pix2face.shards.sample import MAP_LAYERS, Sample
from pix2face.shards.shard_reader import ShardHeader, ShardReader, shard_paths
from pix2face.shards.shard_writing import ShardWriter, write_shard
from tests.benchmarks.measuring import options_parser, processor_ms, write_report

Change = Callable[[np.ndarray], np.ndarray]


def left_differences(steps: np.ndarray) -> np.ndarray:
    """A value less its left neighbour."""
    difference = steps.copy()
    difference[:, 1:] -= steps[:, :-1]
    return difference


def planar_differences(steps: np.ndarray) -> np.ndarray:
    """A value less its left and upper neighbours plus the one between them; signed."""
    stored = predict(steps)[:-1, :-1]
    return ((stored >> 1) ^ -(stored & 1)).view(np.int16)


@dataclass(frozen=True)
class Way:
    """One way to store maps through the HDF5 library.

    Attributes:
        options: Of the dataset.
        change: Before the filters.
        undo: After them.
        divisor: Steps of 1/128 mm are rounded to multiples of it.
        rows: Of a chunk; 0 is all.
        planes: x, y and z of all pixels one after the other.
        is_boxed: The bounding box of the mask alone, padded to the largest of the set.
    """

    options: Mapping[str, Any] = field(default_factory=dict)
    change: Change = lambda steps: steps
    undo: Change = lambda steps: steps
    divisor: int = 1
    rows: int = 0
    planes: bool = False
    is_boxed: bool = False


def gzip(level: int, shuffle: bool = True) -> dict[str, Any]:
    """Options of HDF5's own deflate."""
    return {"compression": "gzip", "compression_opts": level, "shuffle": shuffle}


IN_MM = {
    "change": lambda steps: steps * np.float32(1 / 128),
    "undo": lambda values: np.rint(values * np.float32(128)).astype(np.int16),
}
LEFT = {"change": left_differences, "undo": lambda steps: steps.cumsum(1, dtype=np.int16)}
PLANAR = {
    "change": planar_differences,
    "undo": lambda steps: steps.cumsum(0, dtype=np.int16).cumsum(1, dtype=np.int16),
}
SIGN_LAST = {"change": lambda steps: predict(steps)[:-1, :-1], "undo": undo_prediction}
BLOSC = hdf5plugin.Blosc2
WAYS: dict[str, Way] = {
    "values, gzip 4, no shuffle": Way(gzip(4, shuffle=False)),
    "values, shuffle, gzip 4 (reference)": Way(gzip(4)),
    "values, shuffle, gzip 1": Way(gzip(1)),
    "values, shuffle, gzip 9": Way(gzip(9)),
    "values, shuffle, lzf": Way({"compression": "lzf", "shuffle": True}),
    "values in planes, shuffle, gzip 4": Way(gzip(4), planes=True),
    "values, shuffle, gzip 4, chunks of 32 rows": Way(gzip(4), rows=32),
    "values in the mask's box, shuffle, gzip 4": Way(gzip(4), is_boxed=True),
    "values of 1/64 mm, shuffle, gzip 4": Way(gzip(4), divisor=2),
    "values, shuffle, zstd 3": Way({"shuffle": True, **hdf5plugin.Zstd(clevel=3)}),
    "values, Blosc2 zstd 3, bits shuffled": Way(dict(BLOSC(cname="zstd", clevel=3, filters=BLOSC.BITSHUFFLE))),
    "values in mm as float32, shuffle, gzip 4": Way(gzip(4), **IN_MM),
    "values in mm as float32, shuffle, zstd 3": Way({"shuffle": True, **hdf5plugin.Zstd(clevel=3)}, **IN_MM),
    "left differences, shuffle, gzip 4": Way(gzip(4), **LEFT),
    "planar differences, shuffle, gzip 4": Way(gzip(4), **PLANAR),
    "planar, sign last, shuffle, gzip 1": Way(gzip(1), **SIGN_LAST),
    "planar, sign last, shuffle, gzip 4": Way(gzip(4), **SIGN_LAST),
    "planar, sign last, shuffle, lzf": Way({"compression": "lzf", "shuffle": True}, **SIGN_LAST),
    "planar, sign last, shuffle, zstd 3": Way({"shuffle": True, **hdf5plugin.Zstd(clevel=3)}, **SIGN_LAST),
    "planar, sign last, shuffle, zstd 9": Way({"shuffle": True, **hdf5plugin.Zstd(clevel=9)}, **SIGN_LAST),
    "planar, sign last, Blosc2 zstd 3, bytes shuffled": Way(
        dict(BLOSC(cname="zstd", clevel=3, filters=BLOSC.SHUFFLE)), **SIGN_LAST
    ),
    "planar, sign last, 1/64 mm, shuffle, gzip 4": Way(gzip(4), divisor=2, **SIGN_LAST),
}
PICTURES: dict[str, tuple[str, list[int]]] = {
    "PNG 1": (".png", [cv2.IMWRITE_PNG_COMPRESSION, 1]),
    "PNG 3": (".png", [cv2.IMWRITE_PNG_COMPRESSION, 3]),
    "PNG, OpenCV's choice": (".png", []),
    **{
        f"JPEG {quality}, {name}": (
            ".jpg",
            [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, sampling],
        )
        for quality, name, sampling in (
            (95, "4:2:0", cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420),
            (95, "4:4:4", cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
            (98, "4:4:4", cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
        )
    },
    "WebP, lossless": (".webp", [cv2.IMWRITE_WEBP_QUALITY, 101]),
}


def best_ms(work: Callable[[], object], n: int, rounds: int) -> float:
    """Milliseconds of the processor for one of n, the best of some rounds."""
    (times,) = processor_ms({"work": work}, rounds).values()
    return round(min(times) / n, 3)


def measure_way(way: Way, maps: Sequence[np.ndarray], folder: Path, rounds: int) -> dict[str, float]:
    """Bytes and times of storing the maps (PNCC and offset in turns) of each sample."""
    path, n = folder / "way.h5", len(maps) // 2
    kept = [np.round(steps / way.divisor).astype(np.int16) for steps in maps] if way.divisor > 1 else list(maps)
    if way.is_boxed:
        kept = boxed(kept)

    def write() -> None:
        with h5py.File(path, "w") as file:
            first = arranged(way, way.change(kept[0]))
            chunk = (1, way.rows or first.shape[0], *first.shape[1:])
            dataset = file.create_dataset("maps", (len(kept), *first.shape), first.dtype, chunks=chunk, **way.options)
            for index, steps in enumerate(kept):
                dataset[index] = arranged(way, way.change(steps))

    def read() -> list[np.ndarray]:
        with h5py.File(path, "r") as file:
            stored = (file["maps"][index] for index in range(len(kept)))
            return [way.undo(np.moveaxis(values, 0, -1) if way.planes else values) for values in stored]

    write_ms = best_ms(write, n, rounds)
    if not all(np.array_equal(a, b) for a, b in zip(read(), kept, strict=True)):
        raise AssertionError("what was written does not read back")
    return {
        "maps_kB": round(path.stat().st_size / n / 1e3, 1),
        "write_ms": write_ms,
        "read_ms": best_ms(read, n, rounds),
    }


def arranged(way: Way, steps: np.ndarray) -> np.ndarray:
    """In planes, if the way is so."""
    return np.ascontiguousarray(np.moveaxis(steps, -1, 0)) if way.planes else steps


def boxed(maps: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Each map's bounding box, at the corner of an array that holds the largest."""
    boxes = [np.argwhere(steps.any(axis=-1)) for steps in maps]
    corners = [(box.min(axis=0), box.max(axis=0) + 1) for box in boxes]
    largest = np.max([stop - start for start, stop in corners], axis=0)
    cuts = []
    for steps, (start, stop) in zip(maps, corners, strict=True):
        cut = np.zeros((*largest, 3), np.int16)
        cut[: stop[0] - start[0], : stop[1] - start[1]] = steps[start[0] : stop[0], start[1] : stop[1]]
        cuts.append(cut)
    return cuts


def measure_pictures(images: Sequence[np.ndarray], rounds: int) -> dict[str, dict[str, float]]:
    """Bytes, times and fidelity of picture formats."""
    rows = {}
    for name, (suffix, flags) in PICTURES.items():
        encoded = [cv2.imencode(suffix, image, flags)[1] for image in images]
        decoded = [cv2.imdecode(content, cv2.IMREAD_COLOR) for content in encoded]
        psnr = [min(cv2.PSNR(a, b), 100.0) for a, b in zip(images, decoded, strict=True)]
        rows[name] = {
            "kB": round(float(np.mean([len(content) for content in encoded])) / 1e3, 1),
            "encode_ms": best_ms(
                lambda s=suffix, f=flags: [cv2.imencode(s, image, f) for image in images], len(images), rounds
            ),
            "decode_ms": best_ms(lambda e=encoded: [cv2.imdecode(content, 1) for content in e], len(images), rounds),
            "psnr_dB": round(float(np.mean(psnr)), 1),
        }
    return rows


def measure_shards(header: ShardHeader, samples: Sequence[Sample], folder: Path, rounds: int) -> dict[str, Any]:
    """The project's own writing and reading, of coded layers and of plain ones."""
    rows: dict[str, Any] = {
        name: measure_shard(header, samples, folder / "shard-00000.h5", rounds, is_plain=name == "plain")
        for name in ("plain", "coded")
    }
    content = b"".join(values.tobytes() for values in samples[0].layers.values())[::2]  # as many bytes as in steps
    checksums = {"CRC-32 of ISA-L": isal_zlib.crc32, "CRC-32 of zlib": zlib.crc32, "SHA-256": hashlib.sha256}
    rows["checksum_ms"] = {name: best_ms(lambda c=check: c(content), 1, 9) for name, check in checksums.items()}
    n, path = len(samples), folder / "shard-00000.h5"
    with multiprocessing.get_context("fork").Pool(2) as pool:
        pool.map(read_all, [(path, 1)] * 2)  # the processes are there and the file is in memory
        start = perf_counter()
        seconds = pool.map(read_all, [(path, 4)] * 2)
        rows["two_processes_read_per_second"] = {
            "by_the_clock": round(8 * n / (perf_counter() - start)),
            "of_two_free_cores": round(8 * n / float(np.mean(seconds))),
        }
    return rows


def measure_shard(
    header: ShardHeader, samples: Sequence[Sample], path: Path, rounds: int, *, is_plain: bool
) -> dict[str, float]:
    """Bytes and times of one shard, for one triplet."""
    n = len(samples)

    def packed() -> ShardWriter:
        writer = ShardWriter(header.layers, is_plain=is_plain)
        for sample in samples:
            writer.add(sample)
        return writer

    def read(*layers: str) -> list[Sample]:
        return [reader.read(index, layers) for index in range(n)]

    writer = packed()
    write_ms = best_ms(lambda: writer.write(path, header), n, rounds)
    reader = ShardReader(path)
    return {
        "kB": round(path.stat().st_size / n / 1e3, 1),
        "pack_ms": best_ms(packed, n, rounds),
        "write_and_check_ms": write_ms,
        "read_maps_ms": best_ms(lambda: read(*MAP_LAYERS), n, rounds),
        "read_cut_ms": best_ms(lambda: [reader.stored(index, MAP_LAYERS) for index in range(n)], n, rounds),
        "read_picture_ms": best_ms(lambda: read("image"), n, rounds),
        "decode_picture_ms": best_ms(lambda: [sample.image for sample in read("image")], n, rounds),
    }


def read_all(task: tuple[Path, int]) -> float:
    """Reads each sample some times: its picture decoded, its maps in mm. Returns the processor's seconds."""
    path, times = task
    start = process_time()
    reader = ShardReader(path)
    for index in [*range(len(reader))] * times:
        sample = reader.read(index, DEFAULT_LAYERS)
        _ = sample.image, sample.maps
    return process_time() - start


def measure_folder(shards: Path, n: int, rounds: int) -> dict[str, Any]:
    """Everything, on the first samples of a folder."""
    reader = ShardReader(shard_paths(shards)[0])
    header = replace(reader.header, layers=DEFAULT_LAYERS, rejected="[]")
    samples = [reader.read(index) for index in range(min(n, len(reader)))]
    stored = [reader.stored(index, ("pncc", "offset"), is_whole=True) for index in range(len(samples))]
    maps = [steps for layers in stored for steps in layers.values()]
    images = [sample.image for sample in samples]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        write_shard(folder / "shard-00000.h5", header, samples)
        ways = {name: measure_way(way, maps, folder, rounds) for name, way in WAYS.items()}
        project = measure_shards(header, samples, folder, rounds)
    reference = ways["values, shuffle, gzip 4 (reference)"]
    for row in ways.values():
        row["write_against_reference"] = round(row["write_ms"] / reference["write_ms"], 3)
    return {
        "samples": len(samples),
        "size_px": list(images[0].shape[:2]),
        "face_px": round(float(np.mean([sample.maps.mask.sum() for sample in samples]))),
        "picture_kB": round(float(np.mean([len(sample.image_bytes or b"") for sample in samples])) / 1e3, 1),
        "maps": ways,
        "pictures": measure_pictures(images, rounds),
        "shards": project,
        "packing_against_reference": round(project["coded"]["pack_ms"] / reference["write_ms"], 3),
    }


def main() -> None:
    """Measures every folder and writes the JSON."""
    parser = options_parser(__doc__)
    parser.add_argument("--shards", type=Path, nargs="+", required=True)
    parser.add_argument("--n", type=int, default=24)
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    report = {
        "h5py_hdf5": h5py.version.hdf5_version,
        "folders": {folder.name: measure_folder(folder, options.n, options.rounds) for folder in options.shards},
    }
    write_report(report, options.out)


if __name__ == "__main__":
    main()
