"""The options of the command ``evaluate``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, final

from pix2face.evaluation.benchmarks.manifest import Split
from pix2face.evaluation.subjects.predictions_file import PixelFrame
from pix2face.fitting.face_fit import CameraKind
from pix2face.fitting.least_squares.regularisation import PREDICTED_MAPS_REGULARISATION, Regularisation
from pix2face.geometry.alignment3d import Alignment
from pix2face.geometry.landmark_metrics import Normaliser
from pix2face.models.morphable_model import BUILTIN_MODEL


@final
@dataclass(frozen=True)
class EvaluateConfig:
    """What to evaluate.

    Attributes:
        split: The benchmark.
        data: Folder with its files; default is the environment variable PIX2FACE_DATA.
        checkpoint: What training wrote; default is the packaged one.
        predictions: Measure these landmarks of another system instead (.npz or .csv, docs/reference/evaluation.md),
            or of clips a folder with what pix2face track wrote for each (CLIP/track.npz).
        frame: Where the predictions have the centre of the first pixel: at 0, at 1, or at 0.5.
        oracle: Measure the model fitted to the truth instead: how much of an error is the model's.
        out: Folder for the report; default is out/evaluate-SPLIT.
        model: "builtin" or a model file: the one that the checkpoint was trained for.
        landmarks: Which vertices the landmarks are: a file of pix2face landmarks select. Without it those that the
            checkpoint chooses; of renders, or where it chooses none, the model's own.
        truth: Which of several truths is meant (aflw2000-3d: original or reannotated); default is the benchmark's own.
        reannotated: File of re-annotated landmarks; default is one beside the pictures.
        boxes: Where the network looks: at the true box, as the benchmarks do, or where a detector finds the face.
        normaliser: What errors are divided by; default is the benchmark's own.
        threshold: Where a face counts as failed and the error curve ends, a fraction; default is the benchmark's own.
        contour: 2d lets jaw points slide to the visible outline, as the truth of 300-W and 300-VW does.
        by: Of renders, tell errors apart by these attributes too, or by what is computed of them: skin.melanin,
            light.kind, "abs(yaw_deg)". The language is that of train --where, and datagen stats shows what there is.
            Default is the benchmark's own.
        align: How 3D landmarks are laid onto the true ones (menpo3d-tracking); default is the benchmark's own.
        camera: Camera of the fit.
        regularisation: Tikhonov weight of the coefficients in mm^2; estimate takes one from each face's maps. As in
            pix2face fit.
        silhouette: Hold camera and mesh to the silhouette: no part of the face lies beyond its mask. Of
            weak-perspective cameras.
        reprojection_rounds: How often the camera is fitted again to the fitted mesh, and the coefficients after it.
        crop_scale: Side of the crop that the network is given, in units of the longer side of the face's box; default
            is the checkpoint's own.
        batch_size: Faces that go through the network at once.
        resamples: Draws of the bootstrap that intervals come from; 0 for none.
        seed: Of the draws.
        max_rejected: This many faces with damaged files are tolerated; more make the exit status 3.
    """

    split: Split
    data: Path | None = None
    checkpoint: Path | None = None
    predictions: Path | None = None
    frame: PixelFrame = "0-based"
    oracle: bool = False
    out: Path | None = None
    model: str = BUILTIN_MODEL
    landmarks: Path | None = None
    truth: str | None = None
    reannotated: Path | None = None
    boxes: Literal["truth", "lbp", "lbp-quick", "dlib"] = "truth"
    normaliser: Normaliser | None = None
    threshold: float | None = None
    contour: Literal["off", "2d"] = "off"
    by: tuple[str, ...] | None = None
    align: Alignment | None = None
    camera: CameraKind = "weak-perspective"
    regularisation: Regularisation = PREDICTED_MAPS_REGULARISATION
    silhouette: bool = True
    reprojection_rounds: int = 0
    crop_scale: float | None = None
    batch_size: int = 16
    resamples: int = 1000
    seed: int = 0
    max_rejected: int = 0
