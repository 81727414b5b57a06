"""The options of the command ``evaluate``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, final

import tyro

from pix2face.command_line import choices, optional
from pix2face.commands.pix2face_config import NetworkOptions
from pix2face.detectors import DEFAULT_DETECTOR, SURE_SCORE
from pix2face.evaluation.benchmarks.manifest import Split
from pix2face.fitting.fit_options import DEFAULT_FIT, FitOptions
from pix2face.geometry import Alignment, Normaliser

# Where predictions have the centre of the first pixel: at 0, at 1, or (the project's own frame) at 0.5.
PixelFrame = Literal["0-based", "1-based", "half-pixel"]


@final
@dataclass(frozen=True)
class EvaluateConfig:
    """What to evaluate, and how.

    Attributes:
        split: Benchmark to measure on.
        data: Folder with the files of the benchmark. Default: the folder that the environment variable PIX2FACE_DATA
            names.
        network: Network and model.
        predictions: Measure the landmarks of another system instead of a checkpoint: an .npz or .csv file
            as described in docs/how_to/evaluate.md, or, for clips, a folder with the track.npz that `pix2face track`
            wrote for each clip, as CLIP/track.npz.
        frame: Coordinate of the centre of the first pixel in the predictions: 0, 1 or 0.5.
        oracle: Measure the morphable model fitted to the truth instead of a checkpoint. Its error is the part that the
            model causes.
        out: Folder for the report. Default: out/evaluate-SPLIT.
        truth: Ground truth to measure against, for benchmarks that have several (aflw2000-3d: original or
            reannotated). Default: the benchmark's own.
        reannotated: File of re-annotated landmarks. Default: the one beside the pictures.
        boxes: Boxes that the network gets: the true ones, as in the benchmarks, or those that a detector finds. With
            detected boxes, the report also says how well the detector finds faces.
        detector: Detector for --boxes detected, as for `pix2face fit`.
        min_score: Smallest score of a detected face, as for `pix2face fit`.
        smallest_face: Longer side of the smallest faces to find, as for `pix2face fit`.
        refine: Correct or reject detected boxes by a first prediction, as `pix2face fit` does.
        normaliser: What errors are divided by. Default: the benchmark's own.
        threshold: Error, as a fraction, from which a face counts as failed. The error curve ends there. Default: the
            benchmark's own.
        how: Camera, coefficients and landmarks.
        by: Attributes of renders, or expressions of attributes, by which the errors are also grouped, such as
            skin.melanin, light.kind or "abs(yaw_deg)". Expressions are written as for `train --where`; `datagen stats`
            lists the attributes. Default: the benchmark's own.
        align: How 3D landmarks are aligned with the true ones (menpo3d-tracking). Default: the benchmark's own.
        crop_scale: Side of the network's crop, as a multiple of the longer side of the face's box. Default: the
            checkpoint's own.
        batch_size: Number of faces that the network processes at once.
        resamples: Number of bootstrap resamples for each interval; 0 for no intervals.
        seed: Seed of the bootstrap.
        max_rejected: Largest number of faces with damaged files for which the exit status is still 0. With more, the
            exit status is 3.
        allow_missing: Exit with status 0 even if files of the benchmark are missing. By default, the exit status is
            then 3.
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
    min_score: float = SURE_SCORE
    smallest_face: Annotated[float | None, optional("FLOAT")] = None
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


@final
@dataclass(frozen=True)
class CompareConfig:
    """Compare two reports of the same benchmark face by face: B minus A with 95 % intervals (paired bootstrap).

    Attributes:
        reports: Two reports of the same benchmark, A and B: the files report.json, or the folders that contain them.
        resamples: Number of resamples of the paired bootstrap.
        seed: Seed of the bootstrap.
        out: JSON file for the figures. Default: no file is written.
    """

    reports: Annotated[tuple[Path, Path], tyro.conf.Positional]
    resamples: int = 1000
    seed: int = 0
    out: Annotated[Path | None, optional("PATH")] = None
