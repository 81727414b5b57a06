"""The command ``pix2face landmarks``, which chooses landmarks of a model from annotated frames, and shows them."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int
from numpy import ndarray
from rich.console import Console
from rich.table import Table

from pix2face.command_line import EXIT_REJECTED, check_output_file, counted, progress_bar, say
from pix2face.commands.pix2face_config import LandmarksCommand, LandmarksSelectConfig, LandmarksShowConfig
from pix2face.errors import DegenerateGeometryError, InputFileError, ModelMismatchError, UsageError
from pix2face.face_files.annotations import AnnotatedFace, Annotation, find_annotations
from pix2face.face_files.coefficients import load_coefficients
from pix2face.files.images import read_photograph, write_picture
from pix2face.fitting.face_fit import fit_face
from pix2face.geometry.camera import Camera
from pix2face.geometry.crops import FaceBox
from pix2face.geometry.landmarks import IBUG68, IBUG68_2D, IBUG68_PARTS, INNER51, INNER51_SCHEME, MIRRORS, SCHEMES
from pix2face.inference.predictor import Predictor
from pix2face.landmark_choice.landmark_file import load_landmarks, open_model_with, save_landmarks, with_landmarks
from pix2face.landmark_choice.landmark_offsets import FittedFrame, LandmarkSelection, select_offsets
from pix2face.landmark_choice.landmark_selection import (
    MirrorImages,
    ReprojectionErrors,
    VertexSelection,
    fold_of_frame,
)
from pix2face.models.morphable_model import MorphableModel, open_model
from pix2face.photographs.fit_pictures import draw_model_landmarks

PROBLEMS_SHOWN = 10
MOST_FRAMES = 5_000  # whose fits are remembered: more would tell the offsets no better
console = Console(stderr=True)

CameraAndCoefficients = tuple[Camera, Float64[ndarray, " c"]]
# Fits the face of an annotation, whose points are given as well.
FitFrame = Callable[[Annotation, AnnotatedFace], CameraAndCoefficients]


def landmarks(command: LandmarksCommand) -> int:
    """Runs ``pix2face landmarks``."""
    return _select(command) if isinstance(command, LandmarksSelectConfig) else _show(command)


def _show(config: LandmarksShowConfig) -> int:
    check_output_file(config.out, (".png", ".jpg"))
    model = open_model(config.model)
    scheme = config.scheme if config.file is None else load_landmarks(config.file).scheme
    choices = [model.mean_landmarks(scheme)] if scheme in model.landmarks else []
    if config.file is not None:
        choices.append(with_landmarks(model, config.file).mean_landmarks(scheme))
    if not choices:
        known = ", ".join(sorted(model.landmarks)) or "none"
        raise UsageError(f"expected landmarks {scheme!r} in the model {model.name}, found {known}")
    write_picture(config.out, draw_model_landmarks(model, choices))
    say(console, f"{scheme} of {model.name} -> {config.out}")
    return 0


def _select(config: LandmarksSelectConfig) -> int:
    check_output_file(config.out, (".json",))
    if config.network.checkpoint is not None and config.coeffs is not None:
        raise UsageError("expected --checkpoint (fit predicted maps) or --coeffs (take fits as given), found both")
    annotations = find_annotations(config.data, config.scheme)
    model = open_model_with(config.network.model, config.network.landmarks)
    candidates, mirror = np.flatnonzero(model.is_face_vertex), None
    if model.symmetry is not None and config.scheme in MIRRORS:
        mirror = MirrorImages(MIRRORS[config.scheme], model.symmetry)
        candidates = np.intersect1d(candidates, model.symmetry[candidates])
    errors = ReprojectionErrors(candidates, SCHEMES[config.scheme], config.folds, mirror)
    if config.coeffs is not None:
        fit_frame, origin = _given_fits(model, config.coeffs), str(config.coeffs.name)
    else:
        predictor = Predictor.load(config.network.path, config.network.device)
        fit_frame, origin = _predicted_fits(model, predictor), f"maps predicted by {config.network.path.name}"
    frames, problems = _measure(annotations, fit_frame, model, candidates, errors, config)
    if not frames:
        raise UsageError(f"{config.data}: expected frames that can be fitted, found none: {problems[0]}")
    chosen = errors.select()
    selection = select_offsets(chosen, frames, model, mirror and mirror.landmarks)
    n_frames = len(annotations) - len(problems)
    about = {"data": config.data.name, "fits": origin, "n_frames": n_frames, "folds": config.folds}
    save_landmarks(config.out, model, config.scheme, selection, about)
    _report(config, errors, chosen, selection, model.landmarks.get(config.scheme))
    for problem in problems[:PROBLEMS_SHOWN]:
        say(console, problem)
    left_out = f", {counted(len(problems), 'frame')} left out" if problems else ""
    say(console, f"{counted(n_frames, 'frame')}{left_out} -> {config.out}; use it with --landmarks {config.out}")
    return EXIT_REJECTED if problems else 0


def _measure(
    annotations: list[Annotation],
    fit_frame: FitFrame,
    model: MorphableModel,
    candidates: ndarray,
    errors: ReprojectionErrors,
    config: LandmarksSelectConfig,
) -> tuple[list[FittedFrame], list[str]]:
    """Fits every frame and accumulates its errors.

    Returns:
        The fits of up to ``MOST_FRAMES`` frames, and one message for each frame that was left out.
    """
    frames, problems, step = [], [], math.ceil(len(annotations) / MOST_FRAMES)
    with progress_bar(console, "frames", len(annotations)) as advance:
        for index, annotation in enumerate(annotations):
            try:
                annotated = annotation.load()
                camera, coefficients = fit_frame(annotation, annotated)
                fold = fold_of_frame(index, len(annotations), config.folds)
                identity, expression = np.split(coefficients[None], [model.n_identity], axis=1)
                vertices = model.vertices(identity, expression)[0, candidates].astype(np.float64)
                errors.add(fold, camera.project(vertices), annotated.landmarks2d)
                if index % step == 0:
                    frames.append(FittedFrame(fold, camera, coefficients, annotated.landmarks2d))
            except (InputFileError, DegenerateGeometryError) as error:
                problems.append(f"{annotation.name}: {error}")
            advance()
    return frames, problems


def _given_fits(model: MorphableModel, path: Path) -> FitFrame:
    table = load_coefficients(path)
    if table.model_sha256 != model.sha256:
        raise ModelMismatchError(
            f"{path}: fits of the model {table.model_name} ({table.model_sha256[:12]}), found {model.name} "
            f"({model.sha256[:12]}); give the former with --model"
        )
    row_of = {sample_id: row for row, sample_id in enumerate(table.sample_ids)}

    def fit_frame(annotation: Annotation, _: AnnotatedFace) -> CameraAndCoefficients:
        row = row_of.get(annotation.name)
        if row is None:
            raise InputFileError(f"expected its fit in {path}, found none of this name")
        coefficients = np.concatenate([table.identity[row], table.expression[row]])
        return Camera(table.cameras[row]), coefficients.astype(np.float64)

    return fit_frame


def _predicted_fits(model: MorphableModel, predictor: Predictor) -> FitFrame:
    predictor.header.check_model(model.name, model.sha256)
    framing = next((scheme for scheme in (IBUG68, *model.landmarks) if scheme in model.landmarks), None)
    if framing is None:
        raise UsageError(f"expected a model with landmarks to frame faces by, {model.name} has none; give --coeffs")

    def fit_frame(_: Annotation, annotated: AnnotatedFace) -> CameraAndCoefficients:
        image = read_photograph(annotated.image_path)
        present = np.isfinite(annotated.landmarks2d).all(axis=1)
        box = FaceBox.around(annotated.landmarks2d[present])
        # Crops are defined by the box of the 68 landmarks. With other schemes, a first fit gives this box.
        for _round in range(1 if len(annotated.landmarks2d) == SCHEMES[IBUG68] else 2):
            prediction = predictor.predict(image, box)
            fitted = fit_face(prediction.maps, model, scheme=framing).in_image(prediction.crop)
            box = FaceBox.around(fitted.landmarks2d)
        return fitted.camera, np.concatenate([fitted.identity, fitted.expression])

    return fit_frame


def _report(
    config: LandmarksSelectConfig,
    errors: ReprojectionErrors,
    chosen: VertexSelection,
    selection: LandmarkSelection,
    own: Int[ndarray, " m"] | None,
) -> None:
    """Prints the errors by part of the face, of the model's own vertices and of what was chosen."""
    present = None if own is None else errors.of(own)
    table = Table(title=f"{config.scheme}: mean error, % of sqrt(w h) of the annotated points' box")
    for heading in ("part", "vertices of the model", "chosen vertices", "with offsets", "held-out frames"):
        table.add_column(heading, justify="left" if heading == "part" else "right")
    for part, members in _parts(config.scheme).items():
        row = [None if present is None else present[members], chosen.error[members]]
        row += [selection.error[members], selection.held_out_error[members]]
        table.add_row(part, *("-" if values is None else f"{100 * np.nanmean(values):.2f}" for values in row))
    Console().print(table)


def _parts(scheme: str) -> dict[str, Any]:
    everything = list(range(SCHEMES[scheme]))
    if scheme in (IBUG68, IBUG68_2D):
        return {**{part: list(members) for part, members in IBUG68_PARTS.items()}, "all": everything}
    if scheme == INNER51_SCHEME:
        inner = {part: [INNER51.index(m) for m in members] for part, members in IBUG68_PARTS.items() if part != "jaw"}
        return {**inner, "all": everything}
    return {"all": everything}
