"""The options of the command ``evaluate``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, final

import tyro

from pix2face.evaluation.benchmarks.manifest import Split
from pix2face.evaluation.subjects.predictions_file import PixelFrame
from pix2face.fitting.fit_options import DEFAULT_FIT, FitOptions
from pix2face.geometry.alignment3d import Alignment
from pix2face.geometry.landmark_metrics import Normaliser
from pix2face.models.morphable_model import BUILTIN_MODEL


@final
@dataclass(frozen=True)
class EvaluateConfig:
    """What to evaluate, and how."""

    split: Split
    """The benchmark."""
    data: Path | None = None
    """Folder with the files of the benchmark; without it the environment variable PIX2FACE_DATA names it."""
    checkpoint: Path | None = None
    """Checkpoint that `train` wrote; without it the one that comes with the package."""
    predictions: Path | None = None
    """Measure the landmarks of another system instead: a file .npz or .csv (), or, of clips, a folder
    with what `pix2face track` wrote for each (CLIP/track.npz)."""
    frame: PixelFrame = "0-based"
    """Where the predictions have the centre of the first pixel: at 0, at 1, or at 0.5."""
    oracle: bool = False
    """Measure the model fitted to the truth instead, which shows how much of an error is the model's."""
    out: Path | None = None
    """Folder for the report; without it out/evaluate-SPLIT."""
    model: str = BUILTIN_MODEL
    """`builtin`, or the model file that the checkpoint was trained for."""
    landmarks: Path | None = None
    """Which vertices are the landmarks: a file that `pix2face landmarks select` wrote. Without it the choice of the
    checkpoint; the model's own where the checkpoint makes none, and for renders."""
    truth: str | None = None
    """Which of several truths to measure against (aflw2000-3d: original or reannotated); without it the benchmark's
    own."""
    reannotated: Path | None = None
    """File of re-annotated landmarks; without it one beside the pictures."""
    boxes: Literal["truth", "lbp", "lbp-quick", "dlib"] = "truth"
    """Where the network looks: at the true box, as the benchmarks do, or where a detector finds the face."""
    normaliser: Normaliser | None = None
    """What errors are divided by; without it the benchmark's own."""
    threshold: float | None = None
    """Error, as a fraction, from which a face counts as failed and where the error curve ends; without it the
    benchmark's own."""
    how: Annotated[FitOptions, tyro.conf.arg(name="")] = DEFAULT_FIT
    """Camera, coefficients and landmarks."""
    by: tuple[str, ...] | None = None
    """Attributes of renders, or expressions of them, to divide the errors by as well: skin.melanin, light.kind,
    "abs(yaw_deg)". The language is that of `train --where`; `datagen stats` lists the attributes. Without it the
    benchmark's own."""
    align: Alignment | None = None
    """How 3D landmarks are aligned with the true ones (menpo3d-tracking); without it the benchmark's own."""
    crop_scale: float | None = None
    """Side of the crop that the network is given, in units of the longer side of the face's box; without it the
    checkpoint's own."""
    batch_size: int = 16
    """Faces that go through the network at once."""
    resamples: int = 1000
    """Bootstrap resamples behind each interval; 0 for no intervals."""
    seed: int = 0
    """Seed of the bootstrap."""
    max_rejected: int = 0
    """How many faces with damaged files are tolerated; more make the exit status 3."""
