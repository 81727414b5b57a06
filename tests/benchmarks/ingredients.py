"""What the ingredients of synthetic photographs are worth: trainings without each, measured on photographs.

    python -m tests.benchmarks.ingredients --shards shards/ --data AFLW2000/ [--seeds 0 1] [--at-once 2]

Each row is a training on as many pictures as the others, of those that pass its condition, with the same options, and
``evaluate --split aflw2000-3d`` after it. So an ingredient is left out without rendering anything again. Prints and
writes JSON. Run again, it goes on where it was: a training that is done is not done again.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import MappingProxyType

from pix2face.errors import UsageError
from pix2face.shards.sample_filter import SAMPLE_ID, SampleFilter
from pix2face.shards.shard_reader import ShardReader, shard_paths
from tests.benchmarks.measuring import options_parser, write_report

# What a sample fulfils where the ingredient is not in it.
INGREDIENTS: Mapping[str, str] = MappingProxyType(
    {
        "everything": "",
        "no light and shadow": "light.kind == 'soft'",
        "no occluders and hair": "seen_share > 0.9",
        "no wide pose": "abs(yaw_deg) < 45",
        "no borders": "photograph.border.left + photograph.border.top + photograph.border.right "
        "+ photograph.border.bottom == 0",
    }
)


def main() -> None:
    """Trains, evaluates, prints."""
    parser = options_parser(__doc__, Path("out/ingredients"))
    parser.add_argument("--shards", type=Path, required=True, help="synthetic photographs of preset default")
    parser.add_argument("--data", type=Path, required=True, help="folder of AFLW2000-3D")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--samples", type=int, default=300_000)
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--train-options", default="--batch-size 48 --learning-rate 0.0015 --workers 0 --cache-gb 5")
    parser.add_argument("--only", nargs="+", choices=INGREDIENTS, default=list(INGREDIENTS))
    parser.add_argument("--at-once", type=int, default=1, help="trainings side by side, which share the cores")
    options = parser.parse_args()
    conditions, n_pictures = equal_conditions(options.shards)
    rows: dict[str, dict[str, float]] = {}

    def add(name: str, seed: int) -> None:
        out = options.out / f"{name.replace(' ', '-')}-{seed}"
        rows[f"{name}, seed {seed}"] = measured(options, conditions[name], seed, out)
        summary = {
            "pictures": n_pictures,
            "samples": options.samples,
            "size_px": options.size,
            "conditions": conditions,
            "rows": rows,
        }
        write_report(summary, options.out / "ingredients.json")

    with ThreadPoolExecutor(options.at_once) as pool:
        for done in [pool.submit(add, name, seed) for seed in options.seeds for name in options.only]:
            done.result()


def equal_conditions(shards: Path) -> tuple[dict[str, str], int]:
    """The condition of each ingredient, cut to as many samples as the strictest of them leaves; and how many."""
    passing: dict[str, list[str]] = {name: [] for name in INGREDIENTS}
    filters = {name: SampleFilter(text or "1 == 1", "INGREDIENTS") for name, text in INGREDIENTS.items()}
    for path in shard_paths(shards):
        reader = ShardReader(path)
        for sample_id, attributes in zip(reader.sample_ids, reader.attributes(), strict=True):
            for name, condition in filters.items():
                if condition.passes(sample_id, attributes):
                    passing[name].append(sample_id)
    fewest = min(map(len, passing.values()))
    if not fewest:
        raise UsageError(f"{shards}: expected samples without each ingredient, found none without one of them")
    conditions = {
        name: " and ".join(filter(None, [INGREDIENTS[name], f"{SAMPLE_ID} <= {sorted(found)[fewest - 1]!r}"]))
        for name, found in passing.items()
    }
    return conditions, fewest


def measured(options: argparse.Namespace, condition: str, seed: int, out: Path) -> dict[str, float]:
    """Trains with a condition and a seed, and measures."""
    report = out / "evaluation" / "report.json"
    if not report.exists():
        training = ["--shards", options.shards, "--preset", "cpu", "--size-px", options.size]
        training += ["--cropping", "box", "--crop-scale", 1.5, "--loss-over", "mask"]
        length = ["--samples", options.samples, "--seed", seed, "--out", out, "--where", condition]
        threads = max(1, (os.cpu_count() or 1) // options.at_once)
        run("training.cli", [*training, *length, *options.train_options.split()], threads)
        where = ["--split", "aflw2000-3d", "--data", options.data, "--checkpoint", out / "checkpoint.safetensors"]
        how = ["--allow-missing", "--resamples", 0, "--out", out / "evaluation"]
        run("pix2face.evaluation.cli", [*where, *how], threads)
    rows = json.loads(report.read_text(encoding="utf-8"))["table"]
    (row,) = (row for row in rows if (row["method"], row["points"]) == ("network", "68"))
    per_cent = {name: group["mean"] for name, group in row["groups"].items()}
    per_cent["mean of bins"] = row["mean_of_groups"]
    return {name: round(100 * value, 3) for name, value in per_cent.items()}


def run(module: str, arguments: Sequence[object], threads: int) -> None:
    """Runs one of the project's commands."""
    environment = {**os.environ, "OMP_NUM_THREADS": str(threads)}
    subprocess.run([sys.executable, "-m", module, *map(str, arguments)], check=True, env=environment)


if __name__ == "__main__":
    main()
