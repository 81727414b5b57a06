"""How fast ``datagen render`` is from ``.mat`` + ``.jpg`` to finished shards, on a model of BFM's size.

    python -m tests.benchmarks.render [--originals AFLW2000/] [--n 200] [--workers 2] [--out out/render.json]
    python -m tests.benchmarks.render --long 10000          # one run of 10,000 triplets: is memory flat?

Prints and writes JSON. For 450 px (native) and 256 px: triplets a second for n, 2n and 4n samples with the straight
line through them (what a run costs before its first sample, and what a sample costs), where its time goes, and
the largest worker's memory. In the same run, on one core, a chain of public parts as a reference: SciPy's reader, one
matrix product a face, 16-bit PNG. It has no rasteriser, since no compiled z-buffer can be had from PyPI without a
compiler; its maps are drawn by this project, which is not counted.

Without --originals the faces are invented: coefficients drawn from their standard deviations, pictures of noise.
"""

import argparse
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import scipy.io

from datagen.faces.sources import W300LPFolder
from datagen.jobs.executors import ProcessPool
from datagen.jobs.pipeline import JobSummary, Listener, open_job, run_job
from datagen.jobs.render_job import RenderJob
from datagen.rendering.renderer import Renderer
from pix2face.models.morphable_model import load_model
from tests.benchmarks.measuring import options_parser, write_report
from tests.benchmarks.photograph_folder import (
    EXPRESSION_UNIT,
    IDENTITY_UNIT,
    NATIVE_PX,
    write_folder,
    write_full_size_model,
)

SIZES_PX = (NATIVE_PX, 256)
N_REFERENCE = 30


def measure_size(place: Path, model: Path, size_px: int, options: argparse.Namespace) -> dict[str, object]:
    """Runs of n, 2n and 4n samples, and the reference before and after them."""
    counts = [options.n, 2 * options.n, 4 * options.n]
    folders = [write_folder(place / f"{size_px}-{n}", n, size_px, options.originals) for n in counts]
    before = reference_chain(folders[0], model)
    runs = [timed_run(folder, model, place / "out", options.workers) for folder in folders]
    after = reference_chain(folders[0], model)
    reference = {name: min(before[name], after[name]) for name in before}
    seconds = [run["seconds"] for run in runs]
    per_sample, start = np.polyfit(counts, seconds, 1)
    fitted = np.polyval([per_sample, start], counts)
    reference_ms = sum(reference.values())
    busy_ms = min(run["cpu_ms_per_triplet"]["sum without opening"] for run in runs)
    return {
        "runs": runs,
        "start_seconds": float(start),
        "ms_per_triplet": 1e3 * float(per_sample),
        "triplets_per_second": 1 / float(per_sample),
        # What the same cores give when nobody else uses them.
        "triplets_per_second_of_processor_time": 1e3 * min(options.workers, os.cpu_count() or 1) / busy_ms,
        "largest_deviation_from_line": float(np.abs(fitted / seconds - 1).max()),
        "cpu_ms_per_triplet_and_stage": runs[-1]["cpu_ms_per_triplet"],
        "reference_ms_per_triplet_on_one_core": reference,
        "reference_ms_without_rasteriser": reference_ms,
    }


def timed_run(folder: Path, model: Path, out: Path, workers: int) -> dict[str, Any]:
    """One job, from the folder to its shards; they are removed."""
    started = time.perf_counter()
    summary = run_job(open_job(RenderJob(folder, str(model), seed=0, shard_size=100)), out, ProcessPool(workers))
    seconds = time.perf_counter() - started
    shards = list(out.glob("shard-*.h5"))
    n_bytes = sum(path.stat().st_size for path in shards)
    for path in out.iterdir():
        path.unlink()
    return {
        "samples": summary.n_triplets,
        "rejected": len(summary.rejected),
        "seconds": seconds,
        "bytes_per_triplet": n_bytes / summary.n_triplets,
        "largest_worker_mb": max(summary.peaks_bytes) / 2**20,
        "cpu_ms_per_triplet": by_stage(summary),
    }


def by_stage(summary: JobSummary) -> dict[str, float]:
    """Milliseconds of a processor for each triplet; opening model and folder once for each worker, in all."""
    stages = {name: 1e3 * value / summary.n_triplets for name, value in summary.times.cpu_seconds.items()}
    opening = "open model and source"
    stages["sum without opening"] = sum(value for name, value in stages.items() if name != opening)
    stages[f"{opening} (seconds in all)"] = stages.pop(opening) * summary.n_triplets / 1e3
    return stages


def reference_chain(folder: Path, model_path: Path) -> dict[str, float]:
    """Milliseconds of a processor for each face, by part: what a script of public parts would do, on one core."""
    model = load_model(model_path)
    basis = np.concatenate([model.identity_basis, model.expression_basis]).reshape(-1, model.mean.size)
    source = W300LPFolder(folder, model)
    times = dict.fromkeys(("read .mat (SciPy)", "decode photograph", "one product a face", "two 16-bit PNG"), 0.0)
    renderer = Renderer(model, 16, 16)
    for index in range(N_REFERENCE):
        path = folder / f"{source.sample_ids[index]}.mat"
        face, marks = source.face(index), [time.process_time()]
        fields = scipy.io.loadmat(path)
        marks.append(time.process_time())
        image = cv2.imread(str(path.with_suffix(".jpg")))
        marks.append(time.process_time())
        coefficients = np.vstack(
            [fields["Shape_Para"] / IDENTITY_UNIT[:, None], fields["Exp_Para"] / EXPRESSION_UNIT[:, None]]
        )
        vertices = (coefficients[:, 0].astype(np.float32) @ basis).reshape(-1, 3) + model.mean
        marks.append(time.process_time())
        maps = renderer.with_size(*image.shape[:2]).render(vertices, face.camera)
        drawn = time.process_time()
        for values in (maps["pncc"], maps["offset"]):
            cv2.imencode(".png", np.clip(values * 128 + 32768, 0, 65535).astype(np.uint16))
        passed = [*np.diff(marks), time.process_time() - drawn]
        for name, seconds in zip(times, passed, strict=True):
            times[name] += 1e3 * seconds / N_REFERENCE
    return times


def measure_long(place: Path, model: Path, options: argparse.Namespace) -> dict[str, object]:
    """One run of many samples: triplets a second, and the memory of the largest worker on the way."""
    folder = write_folder(place / "long", min(options.long, 400), NATIVE_PX, options.originals)
    paths = sorted(folder.glob("*.mat"))
    for index in range(len(paths), options.long):
        for suffix in (".mat", ".jpg"):
            original = paths[index % len(paths)].with_suffix(suffix)
            (folder / f"face_{index:06}{suffix}").hardlink_to(original)
    progress: list[tuple[float, int]] = []
    started, done = time.perf_counter(), 0

    def on_progress(n: int) -> None:
        nonlocal done
        done += n
        progress.append((time.perf_counter() - started, done))

    job = RenderJob(folder, str(model), seed=0, shard_size=100)
    summary = run_job(
        open_job(job), place / "out", ProcessPool(options.workers), listener=Listener(on_progress=on_progress)
    )
    peaks = summary.peaks_bytes
    tenth = max(1, len(peaks) // 10)
    halves = [next(seconds for seconds, n in progress if n >= share * options.long) for share in (0.5, 1)]
    return {
        "samples": summary.n_triplets,
        "seconds": progress[-1][0],
        "triplets_per_second": summary.n_triplets / progress[-1][0],
        "seconds_of_first_and_second_half": [halves[0], halves[1] - halves[0]],
        "largest_worker_mb_in_first_tenth": max(peaks[:tenth]) / 2**20,
        "largest_worker_mb": max(peaks) / 2**20,
        "gigabytes": sum(path.stat().st_size for path in (place / "out").glob("*.h5")) / 1e9,
    }


def main() -> None:
    """Measures and writes."""
    parser = options_parser(__doc__, Path("out/render.json"))
    parser.add_argument("--originals", type=Path, help="folder of 300W-LP or AFLW2000-3D files to be copied")
    parser.add_argument("--n", type=int, default=200)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--long", type=int, help="one run of so many samples at 450 px instead")
    options = parser.parse_args()
    result: dict[str, object] = {"workers": options.workers, "faces": "copied" if options.originals else "invented"}
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        model = write_full_size_model(place / "model.h5")
        if options.long:
            result["long"] = measure_long(place, model, options)
        else:
            for size_px in SIZES_PX:
                result[f"{size_px} px"] = measure_size(place, model, size_px, options)
    write_report(result, options.out)


if __name__ == "__main__":
    main()
