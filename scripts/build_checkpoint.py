"""Makes the checkpoint that comes with the package: samples faces, renders them, trains, chooses landmarks, exports.

    python -m scripts.build_checkpoint --out FOLDER [--landmarks-from ANNOTATED]

Every step is a command of the project, printed as it runs. Run it again after an interruption: it goes on where it was.
The result is FOLDER/release; docs/checkpoint.md says how good it is and keeps logs and resolved configurations.
"""

import argparse
import os
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import final

PROGRAMS = Path(sys.executable).parent
APPEARANCE = Path(__file__).parent / "checkpoint" / "appearance.toml"
FACES, PICTURE_PX, SHARD_SIZE, SEED = 40_200, 160, 200, 200
TRAINING = ("--preset", "cpu", "--cropping", "box", "--crop-scale", 1.5, "--loss-over", "mask", "--validation", 0.01)
# One process that loads and two threads that compute are the fastest on two cores, once all samples are in memory.
LOADING = ("--workers", 0, "--cache-gb", 14)


@final
@dataclass(frozen=True)
class Stage:
    """One training; each starts from the weights of the one before.

    Attributes:
        name: Of its folder.
        options: Of `train`, beside those that all share.
    """

    name: str
    options: tuple[object, ...]


# Most pictures are seen small first: a step at 64 px costs a quarter of one at 128 px.
_SMALL = ("--size-px", 64, "--batch-size", 48, "--samples", 480_000, "--learning-rate", 1.5e-3, "--warm-up", 20_000)
_LARGE = ("--size-px", 128, "--samples", 260_000, "--learning-rate", 1e-3, "--warm-up", 5_000)
# Once offsets have left zero, which takes the weight of the preset, PNCC is learned better with less of it.
_LONG = ("--size-px", 128, "--samples", 700_000, "--learning-rate", 1e-3, "--warm-up", 5_000, "--weight-offset", 0.5)
STAGES = (Stage("64px", _SMALL), Stage("128px", _LARGE), Stage("128px-long", _LONG))


def main() -> int:
    """Makes what is not there yet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--landmarks-from", type=Path, help="annotated photographs to choose landmark vertices on")
    options = parser.parse_args()
    out: Path = options.out
    out.mkdir(parents=True, exist_ok=True)
    faces, shards, landmarks = out / "faces.h5", out / "shards", out / "landmarks.json"
    appearance = ("--appearance", APPEARANCE, "--seed", SEED)
    if not faces.exists():
        run("datagen", "sample", "--n", FACES, "--size", PICTURE_PX, *appearance, "--out", faces)
    run("datagen", "render", "--coeffs", faces, *appearance, "--shard-size", SHARD_SIZE, "--out", shards)
    before: tuple[object, ...] = ()
    for stage in STAGES:
        run("train", "--shards", shards, *TRAINING, *LOADING, *stage.options, *before, "--out", out / stage.name)
        before = ("--init", out / stage.name / "checkpoint.safetensors")
    checkpoint = before[1]
    chosen: tuple[object, ...] = ()
    if options.landmarks_from:
        data = ("--data", options.landmarks_from)
        run("pix2face", "landmarks", "select", *data, "--checkpoint", checkpoint, "--out", landmarks)
        chosen = ("--landmarks", landmarks)
    run("train", "export", checkpoint, *chosen, "--out", out / "release")
    return 0


def run(program: str, *arguments: object) -> None:
    """Runs one command of the project; its messages go to the terminal."""
    words = [program, *map(str, arguments)]
    sys.stdout.write(f"\n$ {shlex.join(words)}\n")
    sys.stdout.flush()
    threads = {"OMP_NUM_THREADS": str(os.cpu_count() or 1)} if program == "train" else {}
    subprocess.run([PROGRAMS / program, *words[1:]], check=True, env={**os.environ, **threads})


if __name__ == "__main__":
    sys.exit(main())
