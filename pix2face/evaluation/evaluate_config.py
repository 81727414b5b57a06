"""The options of the command ``evaluate``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, final

import tyro

from pix2face.command_line import choices, optional
from pix2face.commands.face_options import NetworkOptions
from pix2face.detectors.detection import DEFAULT_DETECTOR
from pix2face.evaluation.benchmarks.manifest import Split
from pix2face.fitting.fit_options import DEFAULT_FIT, FitOptions
from pix2face.geometry.landmark_metrics import Alignment, Normaliser

# Where predictions have the centre of the first pixel: at 0, at 1, or (the project's own frame) at 0.5.
PixelFrame = Literal["0-based", "1-based", "half-pixel"]


@final
@dataclass(frozen=True)
class EvaluateConfig:
    """What to evaluate, and how.

    Attributes:
        split: Benchmark to measure on.
        data: Folder with the files of the benchmark; without it the environment variable PIX2FACE_DATA names it.
        network: Network and model.
        predictions: Measure the landmarks of another system instead: a file .npz or .csv (docs/how_to/evaluate.md), or,
            of clips, a folder with what `pix2face track` wrote for each (CLIP/track.npz).
        frame: Where the predictions have the centre of the first pixel: at 0, at 1, or at 0.5.
        oracle: Measure the model fitted to the truth instead, which shows how much of an error is the model's.
        out: Folder for the report; without it out/evaluate-SPLIT.
        truth: Which of several truths to measure against (aflw2000-3d: original or reannotated); without it the
            benchmark's own.
        reannotated: File of re-annotated landmarks; without it one beside the pictures.
        boxes: Where the network looks: at the true box, as the benchmarks do, or where a detector finds the face. The
            report then tells how well it finds faces.
        detector: Detector of --boxes detected, as for `pix2face fit`.
        min_score: Smallest score of a detected face, as for `pix2face fit`.
        refine: Correct, confirm and refute detected boxes by a first prediction, as `pix2face fit` does.
        normaliser: What errors are divided by; without it the benchmark's own.
        threshold: Error, as a fraction, from which a face counts as failed and where the error curve ends; without it
            the benchmark's own.
        how: Camera, coefficients and landmarks.
        by: Attributes of renders, or expressions of them, by which errors are told apart as well, such as skin.melanin,
            light.kind or "abs(yaw_deg)". The language is that of `train --where`; `datagen stats` lists the attributes.
            Without it the benchmark's own.
        align: How 3D landmarks are aligned with the true ones (menpo3d-tracking); without it the benchmark's own.
        crop_scale: Side of the crop that the network is given, in units of the longer side of the face's box; without
            it the checkpoint's own.
        batch_size: Faces that go through the network at once.
        resamples: Bootstrap resamples behind each interval; 0 for no intervals.
        seed: Seed of the bootstrap.
        max_rejected: Largest number of faces with damaged files for which the exit status is still 0; with more, it
            is 3.
        allow_missing: Exit with status 0 although files of the benchmark are missing; without it the status is 3.
    """

    split: Split
    data: Annotated[Path | None, optional("PATH")] = None
    network: Annotated[NetworkOptions, tyro.conf.arg(name="")] = NetworkOptions()
    predictions: Annotated[Path | None, optional("PATH")] = None
    frame: PixelFrame = "0-based"
    oracle: bool = False
    out: Annotated[Path | None, optional("PATH")] = None
    truth: Annotated[str | None, optional("STR")] = None
    reannotated: Annotated[Path | None, optional("PATH")] = None
    boxes: Literal["truth", "detected"] = "truth"
    detector: str = DEFAULT_DETECTOR
    min_score: Annotated[float | None, optional("FLOAT")] = None
    refine: bool = True
    normaliser: Annotated[Normaliser | None, optional(choices(Normaliser))] = None
    threshold: Annotated[float | None, optional("FLOAT")] = None
    how: Annotated[FitOptions, tyro.conf.arg(name="")] = DEFAULT_FIT
    by: Annotated[tuple[str, ...] | None, optional("STR [STR ...]")] = None
    align: Annotated[Alignment | None, optional(choices(Alignment))] = None
    crop_scale: Annotated[float | None, optional("FLOAT")] = None
    batch_size: int = 16
    resamples: int = 1000
    seed: int = 0
    max_rejected: int = 0
    allow_missing: bool = False
