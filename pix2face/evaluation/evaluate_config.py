"""The options of the command ``evaluate``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, final

import tyro

from pix2face.command_line import choices, optional
from pix2face.commands.face_options import NetworkOptions
from pix2face.evaluation.benchmarks.manifest import Split
from pix2face.fitting.fit_options import DEFAULT_FIT, FitOptions
from pix2face.geometry.landmark_metrics import Alignment, Normaliser

# Where predictions have the centre of the first pixel: at 0, at 1, or (the project's own frame) at 0.5.
PixelFrame = Literal["0-based", "1-based", "half-pixel"]


@final
@dataclass(frozen=True)
class EvaluateConfig:
    """What to evaluate, and how."""

    split: Split
    """The benchmark."""
    data: Annotated[Path | None, optional("PATH")] = None
    """Folder with the files of the benchmark; without it the environment variable PIX2FACE_DATA names it."""
    network: Annotated[NetworkOptions, tyro.conf.arg(name="")] = NetworkOptions()
    """Network and model."""
    predictions: Annotated[Path | None, optional("PATH")] = None
    """Measure the landmarks of another system instead: a file .npz or .csv (), or, of clips, a folder
    with what `pix2face track` wrote for each (CLIP/track.npz)."""
    frame: PixelFrame = "0-based"
    """Where the predictions have the centre of the first pixel: at 0, at 1, or at 0.5."""
    oracle: bool = False
    """Measure the model fitted to the truth instead, which shows how much of an error is the model's."""
    out: Annotated[Path | None, optional("PATH")] = None
    """Folder for the report; without it out/evaluate-SPLIT."""
    truth: Annotated[str | None, optional("STR")] = None
    """Which of several truths to measure against (aflw2000-3d: original or reannotated); without it the benchmark's
    own."""
    reannotated: Annotated[Path | None, optional("PATH")] = None
    """File of re-annotated landmarks; without it one beside the pictures."""
    boxes: Literal["truth", "lbp", "lbp-quick", "dlib"] = "truth"
    """Where the network looks: at the true box, as the benchmarks do, or where a detector finds the face."""
    normaliser: Annotated[Normaliser | None, optional(choices(Normaliser))] = None
    """What errors are divided by; without it the benchmark's own."""
    threshold: Annotated[float | None, optional("FLOAT")] = None
    """Error, as a fraction, from which a face counts as failed and where the error curve ends; without it the
    benchmark's own."""
    how: Annotated[FitOptions, tyro.conf.arg(name="")] = DEFAULT_FIT
    """Camera, coefficients and landmarks."""
    by: Annotated[tuple[str, ...] | None, optional("STR [STR ...]")] = None
    """Attributes of renders, or expressions of them, to divide the errors by as well: skin.melanin, light.kind,
    "abs(yaw_deg)". The language is that of `train --where`; `datagen stats` lists the attributes. Without it the
    benchmark's own."""
    align: Annotated[Alignment | None, optional(choices(Alignment))] = None
    """How 3D landmarks are aligned with the true ones (menpo3d-tracking); without it the benchmark's own."""
    crop_scale: Annotated[float | None, optional("FLOAT")] = None
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
