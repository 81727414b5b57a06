"""The command ``evaluate``: a checkpoint, or another system's landmarks, on a benchmark; ``evaluate compare``."""

import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from pix2face.command_line import (
    EXIT_REJECTED,
    check_max_rejected,
    check_output_folder,
    counted,
    prepare_output_folder,
    progress_bar,
    say,
)
from pix2face.detectors import DEFAULT_DETECTOR, SURE_SCORE
from pix2face.detectors.detection import open_detector
from pix2face.errors import InputFileError, UsageError
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFiles
from pix2face.evaluation.benchmarks.benchmark_search import find_benchmark
from pix2face.evaluation.benchmarks.manifest import Manifest, load_manifest
from pix2face.evaluation.evaluate_config import EvaluateConfig
from pix2face.evaluation.evaluator import Evaluator, FaceResult, evaluate_faces, frontal_landmarks, model_landmarks
from pix2face.evaluation.figures.attribute_bins import AttributeValues, attribute_values
from pix2face.evaluation.figures.bootstrap import Bootstrap
from pix2face.evaluation.report.evaluation_report import EvaluationSettings, Report, make_report
from pix2face.evaluation.report.report_files import write_report
from pix2face.evaluation.report.report_pictures import Cases
from pix2face.evaluation.report.report_text import report_notes, report_tables
from pix2face.evaluation.subjects.measured_subject import open_subject, versions
from pix2face.fitting.fit_options import DEFAULT_FIT
from pix2face.geometry.crops import LARGEST_CROP_SCALE, SMALLEST_CROP_SCALE
from pix2face.landmark_choice.landmark_file import open_model_with
from pix2face.models.morphable_model import MorphableModel

DATA_VARIABLE = "PIX2FACE_DATA"
N_CASES = 12


def evaluate(config: EvaluateConfig) -> int:
    """Measures a checkpoint, or the landmarks of another system, on a benchmark."""
    _check_numbers(config)
    manifest = _as_asked(config, load_manifest(config.split))
    if config.how.landmark_type == "auto":
        config = replace(config, how=replace(config.how, landmark_type=manifest.landmark_type))
    model = open_model_with(config.network.model, config.network.landmarks)
    model_landmarks(model)  # a model without them is refused before anything takes time
    data = config.data or os.environ.get(DATA_VARIABLE)
    found = find_benchmark(manifest, Path(data) if data else None, model, config.reannotated)
    by = _attribute_values(config, manifest, found)
    out = config.out or Path("out") / f"evaluate-{config.split}"
    check_output_folder(out)
    subject, description = open_subject(config, model, manifest, found)
    settings = EvaluationSettings(
        method=subject.method,
        alignment=config.align or manifest.alignment or "rigid",
        landmark_type=config.how.landmark_type,
        bootstrap=Bootstrap(config.resamples, config.seed),
        by=by,
    )
    evaluator = Evaluator(model, subject, manifest.normaliser, settings.alignment)
    prepare_output_folder(out)
    with progress_bar(Console(stderr=True), f"evaluate {manifest.split}", len(found.items)) as advance:
        results, unreadable = evaluate_faces(found.items, evaluator, advance, config.batch_size)
    facts = _facts(config, model, description)
    report = make_report(manifest, settings, facts, results, found.missing, (*found.unreadable, *unreadable))
    _check_some_evaluated(report)
    worst, best = (_with_pictures(cases, found) for cases in (report.worst(N_CASES), report.best(N_CASES)))
    written = write_report(report, worst, best, frontal_landmarks(model), out)
    console = Console()
    for table in report_tables(report):
        console.print(table)
    for note in (*report_notes(report), f"Written: {', '.join(str(path) for path in written)}"):
        say(console, note)
    is_lacking = report.lacks_files and not config.allow_missing
    if is_lacking:
        say(Console(stderr=True), f"{report.title}: the exit status is 3; --allow-missing accepts missing files")
    return EXIT_REJECTED if is_lacking or len(report.unreadable) > config.max_rejected else 0


def _check_numbers(config: EvaluateConfig) -> None:
    check_max_rejected(config.max_rejected)
    config.how.check()
    if config.crop_scale is not None and not SMALLEST_CROP_SCALE <= config.crop_scale <= LARGEST_CROP_SCALE:
        raise UsageError(
            f"expected --crop-scale from {SMALLEST_CROP_SCALE:g} to {LARGEST_CROP_SCALE:g}, found {config.crop_scale}"
        )
    if config.threshold is not None and not 0 < config.threshold < float("inf"):
        raise UsageError(f"expected a positive --threshold as a fraction (0.08 is 8 %), found {config.threshold}")
    numbers = (("--batch-size", config.batch_size, 1), ("--resamples", config.resamples, 0), ("--seed", config.seed, 0))
    for name, value, least in numbers:
        if value < least:
            raise UsageError(f"{name}: expected {least} or more, found {value}")
    of_detection = {
        "--detector": config.detector != DEFAULT_DETECTOR,
        "--min-score": config.min_score != SURE_SCORE,
        "--smallest-face": config.smallest_face is not None,
        "--no-refine": not config.refine,
    }
    given = [name for name, is_given in of_detection.items() if is_given]
    if config.boxes == "detected":
        open_detector(config.detector, config.smallest_face)  # an unknown one is refused before anything takes time
    elif given:
        raise UsageError(f"{given[0]}: expected --boxes detected with it")
    if config.predictions is None and config.frame != "0-based":
        raise UsageError(f"--frame {config.frame}: expected --predictions with it")
    subjects = {
        "--checkpoint": config.network.checkpoint is not None,
        "--predictions": config.predictions is not None,
        "--oracle": config.oracle,
    }
    chosen = [option for option, is_given in subjects.items() if is_given]
    if len(chosen) > 1:
        raise UsageError(f"expected one of --checkpoint, --predictions and --oracle, found {' and '.join(chosen)}")


def _check_of_networks_alone(config: EvaluateConfig) -> None:
    """Refuses options that apply only to a network when none is measured."""
    if config.predictions is None and not config.oracle:
        return
    of_networks = {
        "--regularisation": config.how.regularisation != DEFAULT_FIT.regularisation,
        "--no-silhouette": not config.how.silhouette,
        "--no-correction": not config.how.correction,
        "--reprojection-rounds": config.how.reprojection_rounds > 0,
        "--crop-scale": config.crop_scale is not None,
    }
    given = [name for name, is_given in of_networks.items() if is_given]
    if given:
        raise UsageError(f"{given[0]}: expected a checkpoint to measure; nothing else goes by it")


def _as_asked(config: EvaluateConfig, manifest: Manifest) -> Manifest:
    """The benchmark with the changes that the command line asks for."""
    manifest = manifest.with_truth(config.truth or manifest.truth)
    _check_of_networks_alone(config)
    for option, name in (("--camera", "camera"), ("--landmark-type", "landmark_type")):
        if config.predictions is not None and getattr(config.how, name) != getattr(DEFAULT_FIT, name):
            raise UsageError(f"{option}: expected a checkpoint or --oracle; landmarks of a file are not fitted")
    has_space = manifest.alignment not in (None, "depth")
    if config.align is not None and config.align != manifest.alignment and (config.align == "depth" or not has_space):
        place = "" if manifest.alignment is None else " in a picture" if config.align == "depth" else " in space"
        raise UsageError(f"--align {config.align}: expected a split with 3D landmarks{place}, found {config.split}")
    if config.boxes == "detected":
        if config.predictions is not None or config.oracle:
            raise UsageError("--boxes detected: expected a checkpoint to measure; nothing else looks at boxes")
        refined = "corrected or rejected by a first prediction" if config.refine else "as they are"
        rule = (
            f"boxes of the detector {config.detector}, {refined}. Of those whose centre lies in the tight box of the "
            "true landmarks and whose longer side is within a factor of 2 of its own, the one that overlaps it most; "
            "a face without one counts as not found"
        )
        manifest = replace(manifest, box_rule=rule)
    elif config.predictions is not None:
        manifest = replace(manifest, box_rule="whatever the other system used")
    elif config.oracle:
        manifest = replace(manifest, box_rule="none is used")
    if config.by is not None and manifest.kind != "shards":
        raise UsageError(f"--by: expected a split of renders, whose attributes are known, found {config.split}")
    return replace(
        manifest,
        by=manifest.by if config.by is None else config.by,
        normaliser=config.normaliser or manifest.normaliser,
        threshold=config.threshold or manifest.threshold,
        alignment=config.align or manifest.alignment,
    )


def _attribute_values(config: EvaluateConfig, manifest: Manifest, found: BenchmarkFiles) -> tuple[AttributeValues, ...]:
    try:
        return attribute_values(manifest.by, found.items)
    except UsageError as error:
        if config.by is not None:
            raise
        raise UsageError(f"{error}. {manifest.split} takes these by itself. {manifest.how_to_get_it}") from error


def _facts(config: EvaluateConfig, model: MorphableModel, description: dict[str, Any]) -> dict[str, Any]:
    """Facts about the evaluation for the report: sentences to print, and everything needed to repeat it."""
    options = vars(config) | vars(config.how) | vars(config.network)
    nested = ("how", "network")
    given = {key: value if value is None else str(value) for key, value in options.items() if key not in nested}
    return {
        **description,
        "model": f"{model.name} ({model.sha256[:12]})",
        "hashes": {**description.get("hashes", {}), "model": model.sha256},
        "configuration": given,
        "versions": versions(),
    }


def _check_some_evaluated(report: Report) -> None:
    """Refuses to report means over no face, and prints the reasons instead."""
    if report.results:
        return
    for face in report.unreadable[:N_CASES]:
        say(Console(stderr=True), f"{face.name}: {face.reason}")
    raise UsageError(
        f"{report.manifest.split}: expected at least one face that can be evaluated, found "
        f"{counted(len(report.unreadable), 'unreadable file')} and nothing else; no report is written"
    )


def _with_pictures(results: Sequence[FaceResult], found: BenchmarkFiles) -> Cases:
    items = {item.name: item for item in found.items}
    cases = []
    for result in results:
        face = items[result.name].load()
        with suppress(InputFileError):  # landmarks from a file are measured without looking at the picture
            face = face.with_image()
        cases.append((face, result))
    return cases
