"""How fast ``datagen render`` draws synthetic photographs, with maps and masks, from a table to finished shards.

    python -m tests.benchmarks.photographs [--n 600] [--size 256] [--appearance default] [--workers 2] [--out FILE.json]
    python -m tests.benchmarks.photographs --n 100000 --size 160 --shards FOLDER     # one long run: is memory flat?

Prints and writes JSON: pictures a second by the clock, from the first shard that is finished on (starting up is not in
it); what the processors needed for one, by stage, and how many a second that is where nobody else uses them; and the
most memory that a worker has had after the first tenth of its work, and at the end. With --shards the table and the
shards are kept, and a run that was stopped goes on; pictures a second are then those of the rest.
"""

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from datagen.appearance.appearance_config import DEFAULT, load_configuration
from datagen.jobs.executors import ProcessPool
from datagen.jobs.pipeline import Listener, open_job, run_job
from datagen.jobs.render_job import RenderJob
from datagen.sampling.faces import sample_faces
from pix2face.errors import UsageError
from pix2face.face_files.coefficients import save_coefficients
from pix2face.models import BUILTIN_MODEL
from pix2face.models.morphable_model import builtin_model
from pix2face.shards.layers import DEFAULT_LAYERS, SEEN, order_layers
from tests.benchmarks.measuring import options_parser, write_report
from tests.benchmarks.render import by_stage


def measure(place: Path, options: argparse.Namespace) -> dict[str, object]:
    """Runs the job."""
    appearance, table = load_configuration(options.appearance), place / "faces.h5"
    if not table.exists():  # a run that was stopped goes on with the faces that it has
        faces = sample_faces(builtin_model(), options.n, options.seed, options.size, appearance.geometry)
        save_coefficients(faces, table)
    layers = order_layers(DEFAULT_LAYERS if appearance.is_plain else (*DEFAULT_LAYERS, SEEN))
    job = RenderJob(table, BUILTIN_MODEL, options.seed, options.shard_size, layers, appearance=appearance)
    progress: list[tuple[float, int]] = []

    def on_progress(n: int) -> None:
        progress.append((time.perf_counter(), n))

    summary = run_job(
        open_job(job), place / "shards", ProcessPool(options.workers), listener=Listener(on_progress=on_progress)
    )
    if len(progress) < 2:
        raise UsageError(f"{place}: expected at least two shards to be drawn, found {len(progress)} left to draw")
    (began, _), (ended, _) = progress[0], progress[-1]
    n_drawn, cores = sum(n for _, n in progress), min(options.workers, os.cpu_count() or 1)
    peaks = [n_bytes / 2**20 for n_bytes in summary.peaks_bytes]
    stages = by_stage(replace(summary, n_triplets=n_drawn))
    return {
        "pictures": summary.n_triplets,
        "rejected": len(summary.rejected),
        "shards_that_were_there": summary.n_shards_kept,
        "pictures_per_second": sum(n for _, n in progress[1:]) / max(ended - began, 1e-9),
        "pictures_per_second_of_processor_time": 1e3 * cores / stages["sum without opening"],
        "cpu_ms_per_picture_and_stage": stages,
        "largest_worker_mb_in_first_tenth": max(peaks[: max(1, len(peaks) // 10)]),
        "largest_worker_mb": max(peaks),
        "kilobytes_per_picture": sum(own.stat().st_size for own in (place / "shards").glob("*.h5"))
        / summary.n_triplets
        / 1e3,
    }


def main() -> None:
    """Measures and writes."""
    parser = options_parser(__doc__, Path("out/photographs.json"))
    parser.add_argument("--n", type=int, default=600)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--appearance", default=DEFAULT, help="preset, or TOML file, as of `datagen render`")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--shard-size", type=int, default=20)
    parser.add_argument("--shards", type=Path, help="folder to keep; without it everything is removed")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        found = measure(options.shards or Path(name), options)
    described = {name: getattr(options, name) for name in ("size", "appearance", "seed", "workers", "shard_size")}
    write_report({**described, **found}, options.out)


if __name__ == "__main__":
    main()
