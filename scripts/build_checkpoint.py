"""Makes the packaged checkpoint: samples faces, renders them, trains, chooses landmarks and exports.

    python -m scripts.build_checkpoint --out FOLDER [--landmarks-from ANNOTATED] [--rehearse]

Every step is a command of the project, printed as it runs. After an interruption, run the script again: it continues
where it stopped. The result is FOLDER/release. docs/explanation/packaged_network.md has its figures;
docs/measurements/packaged_network has its logs and resolved configurations.
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
PICTURE_PX, SHARD_SIZE = 160, 200
# A rehearsal runs every command on a small amount of data, to show in minutes that they fit together.
REHEARSED_SHARE = 1 / 1000
REHEARSED_VALIDATION = 0.2  # larger, so that at least one of the few persons is held out
# Crops that vary in size, place and rotation, also at 128 px. These options are not on the command line.
VARIED_CROPS = Path(__file__).parent / "checkpoint" / "varied_crops.json"
TRAINING = ("--preset", "cpu", "--cropping", "box", "--crop-scale", 1.5, "--loss-over", "mask")
# On two cores, it is fastest to load samples in the training process if all of them are cached in memory. Otherwise, a
# separate process reads them from files.
FROM_MEMORY, FROM_FILES = ("--workers", 0, "--cache-gb", 14), ("--workers", 1, "--cache-gb", 10)


@final
@dataclass(frozen=True)
class Pictures:
    """A set of renders."""

    name: str  # name of the folder of shards
    n_faces: int  # number of faces
    seed: int  # seed of faces and photographs


FIRST, MORE = Pictures("shards", 40_200, 200), Pictures("shards-more", 100_000, 300)
VARIED, LAST = Pictures("shards-varied", 22_000, 400), Pictures("shards-last", 15_600, 500)
CORRECTED = Pictures("shards-correction", 20_000, 600)


@final
@dataclass(frozen=True)
class Stage:
    """One training. Each starts from the weights of the previous one."""

    name: str  # name of its folder
    n_samples: int  # number of samples that it draws
    options: tuple[object, ...]  # options of `train`, in addition to those that all trainings share
    shares: tuple[tuple[Pictures, float], ...] = ((FIRST, 1.0),)  # share of samples from each set of pictures
    loading: tuple[object, ...] = FROM_MEMORY  # options of `train` for loading samples
    validation: float = 0.01  # share of the persons that are held out
    training: tuple[object, ...] = TRAINING  # options that are the same in several trainings


def _varied(name: str, n_samples: int, pictures: Pictures, *options: object, validation: float = 0.01) -> Stage:
    """Makes a training with varied crops of one set of pictures."""
    return Stage(name, n_samples, options, ((pictures, 1.0),), (), validation, ("--config", VARIED_CROPS))


# The first trainings did not recompute the statistics of their norms at the end, since the option did not exist.
_EARLIER = ("--norm-batches", 0)
_LARGE = ("--size-px", 128, "--learning-rate", 1e-3, "--warm-up", 5_000)
# Offsets need the preset's weight to move away from zero. Afterwards, a smaller weight improves PNCC.
_PNCC_FIRST = (*_LARGE, "--weight-offset", 0.5)
_LINEAR = ("--weight-linear", 2, "--precision", "float32")
STAGES = (
    # First at a small size, since a step at 64 px takes a quarter of the time of one at 128 px.
    Stage(
        "64px",
        480_000,
        (*_EARLIER, "--size-px", 64, "--batch-size", 48, "--learning-rate", 1.5e-3, "--warm-up", 20_000),
    ),
    Stage("128px", 260_000, (*_EARLIER, *_LARGE)),
    Stage("128px-long", 700_000, (*_EARLIER, *_PNCC_FIRST)),
    Stage("128px-more", 560_000, _PNCC_FIRST, ((MORE, 0.75), (FIRST, 0.25)), FROM_FILES, validation=0.005),
    # New pictures, crops that vary like the boxes of a detector, landmarks, and scales of errors.
    _varied("128px-varied", 260_000, VARIED),
    # The linear part of the errors rotates the fitted camera. For the packaged network, this stage was stopped after
    # 58,512 samples.
    _varied("128px-linear", 92_000, LAST, *_LINEAR, "--learning-rate", 8e-5, "--warm-up", 2_000, validation=0.015),
    _varied("128px-last", 18_000, LAST, *_LINEAR, "--learning-rate", 5e-5, "--warm-up", 480, validation=0.015),
)


def main() -> int:
    """Runs all steps that are not done yet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--landmarks-from", type=Path, help="annotated photographs to choose landmark vertices on")
    parser.add_argument("--rehearse", action="store_true", help="use a thousandth of all data, in FOLDER/rehearsal")
    options = parser.parse_args()
    share = REHEARSED_SHARE if options.rehearse else 1
    out: Path = options.out / "rehearsal" if options.rehearse else options.out
    out.mkdir(parents=True, exist_ok=True)
    for pictures in (FIRST, MORE, VARIED, LAST, CORRECTED):
        render(pictures, share, out)
    checkpoint: Path | None = None
    for stage in STAGES:
        checkpoint = train(stage, share, checkpoint, out)
    checkpoint = correct(share, checkpoint, out)
    chosen: tuple[object, ...] = ()
    if options.landmarks_from:
        landmarks = out / "landmarks.json"
        data = ("--data", options.landmarks_from)
        run("pix2face", "landmarks", "select", *data, "--checkpoint", checkpoint, "--out", landmarks)
        chosen = ("--landmarks", landmarks)
    run("train", "export", checkpoint, *chosen, "--out", out / "release")
    return 0


def render(pictures: Pictures, share: float, out: Path) -> None:
    """Samples faces and renders photographs of them."""
    faces = out / f"{pictures.name}.h5"
    appearance = ("--appearance", APPEARANCE, "--seed", pictures.seed)
    if not faces.exists():
        n_faces = round(pictures.n_faces * share)
        run("datagen", "sample", "--n", n_faces, "--size", PICTURE_PX, *appearance, "--out", faces)
    run("datagen", "render", "--coeffs", faces, *appearance, "--shard-size", SHARD_SIZE, "--out", out / pictures.name)


def train(stage: Stage, share: float, before: Path | None, out: Path) -> Path:
    """Trains, from the weights of another training if there is one, and returns the checkpoint's path."""
    shards = [f"{out / pictures.name}:{weight}" for pictures, weight in stage.shares]
    start = () if before is None else ("--init", before)
    amounts = ("--samples", round(stage.n_samples * share))
    amounts += ("--validation", stage.validation if share == 1 else REHEARSED_VALIDATION)
    options = (*stage.training, *stage.loading, *stage.options, *amounts, *start)
    run("train", "--shards", *shards, *options, "--out", out / stage.name)
    return out / stage.name / "checkpoint.safetensors"


def correct(share: float, before: Path | None, out: Path) -> Path:
    """Trains the correction of fits alone, then together with the network; returns the checkpoint's path."""
    alone = ("--frozen", "--batch-size", 64, "--learning-rate", 1e-3, "--warm-up", 4_000, "--clip", 0)
    for name, epochs, epoch_size, options in (("correction", 6, 6_400, alone), ("together", 12, 6_000, ())):
        amounts = ("--epochs", epochs, "--epoch-size", round(epoch_size * share) or 1)
        sources = ("--shards", out / CORRECTED.name, "--checkpoint", before)
        run("train", "correction", *sources, *amounts, *options, "--out", out / name)
        before = out / name / "checkpoint.safetensors"
    assert before is not None
    return before


def run(program: str, *arguments: object) -> None:
    """Runs one command of the project; its messages go to the terminal."""
    words = [program, *map(str, arguments)]
    sys.stdout.write(f"\n$ {shlex.join(words)}\n")
    sys.stdout.flush()
    threads = {"OMP_NUM_THREADS": str(os.cpu_count() or 1)} if program == "train" else {}
    subprocess.run([PROGRAMS / program, *words[1:]], check=True, env={**os.environ, **threads})


if __name__ == "__main__":
    sys.exit(main())
