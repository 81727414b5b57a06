"""The command ``evaluate``: a checkpoint on a benchmark."""

import json
import os
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal, final

import tyro
from jaxtyping import Float64
from numpy import ndarray
from rich.console import Console

from pix2face import __version__
from pix2face.benchmark_data import BenchmarkFace, BenchmarkFiles, find_benchmark
from pix2face.command_line import (
    EXIT_REJECTED,
    check_max_rejected,
    counted,
    prepare_output_folder,
    progress_bar,
    run_commands,
    say,
)
from pix2face.errors import UsageError
from pix2face.evaluation import Evaluator, FaceResult, evaluate_faces, model_landmarks
from pix2face.evaluation_report import Report, make_report
from pix2face.face_maps import FaceMaps
from pix2face.fitting.coefficient_fit import PREDICTED_MAPS_REGULARISATION
from pix2face.fitting.face_fit import CameraKind, FaceFit, fit_face
from pix2face.manifest import Manifest, load_manifest
from pix2face.morphable_model import BUILTIN_MODEL, MorphableModel, open_model
from pix2face.predictor import Predictor
from pix2face.report import report_notes, report_table, write_report
from pix2face.runs import latest_checkpoint

DESCRIPTION = "Measures a checkpoint on a benchmark: a table, report.json, an error curve and the worst cases."
DATA_VARIABLE = "PIX2FACE_DATA"
N_WORST = 12


@final
@dataclass(frozen=True)
class EvaluateConfig:
    """What to evaluate.

    Attributes:
        split: The benchmark.
        data: Folder with its files; default is the environment variable PIX2FACE_DATA.
        checkpoint: What training wrote; default is the last one below runs/.
        out: Folder for the report; default is out/evaluate-SPLIT.
        model: "builtin" or a model file: the one that the checkpoint was trained for.
        camera: Camera of the fit.
        regularisation: Tikhonov weight of the coefficients in mm^2.
        max_rejected: This many faces with damaged files are tolerated; more make the exit status 3.
    """

    split: Literal["ibug", "300w-common", "300w-full", "aflw2000-3d", "builtin-heldout"]
    data: Path | None = None
    checkpoint: Path | None = None
    out: Path | None = None
    model: str = BUILTIN_MODEL
    camera: CameraKind = "weak-perspective"
    regularisation: float = PREDICTED_MAPS_REGULARISATION
    max_rejected: int = 0


def evaluate(config: Annotated[EvaluateConfig, tyro.conf.arg(name="")]) -> int:
    """Measures a checkpoint on a benchmark: a table, report.json, an error curve and the worst cases."""
    check_max_rejected(config.max_rejected)
    if not 0 < config.regularisation < float("inf"):
        raise UsageError(f"expected a positive --regularisation in mm^2, found {config.regularisation}")
    manifest = load_manifest(config.split)
    model = open_model(config.model)
    model_landmarks(model)  # a model without them is refused before anything takes time
    found = find_benchmark(manifest, _data_folder(config), model)
    checkpoint = config.checkpoint or latest_checkpoint()
    predictor = Predictor.load(checkpoint)
    predictor.header.check_model(model.name, model.sha256)
    evaluator = Evaluator(model, predictor, partial(_fit, model, config), manifest.normaliser)
    subject = describe(config, checkpoint, predictor, model)
    out = config.out or Path("out") / f"evaluate-{config.split}"
    prepare_output_folder(out)
    report = _evaluate(manifest, found, evaluator, subject)
    _check_some_evaluated(report)
    written = write_report(report, _worst_cases(report, found), out)
    _print(Console(), report, written)
    return EXIT_REJECTED if len(report.unreadable) > config.max_rejected else 0


def describe(config: EvaluateConfig, checkpoint: Path, predictor: Predictor, model: MorphableModel) -> dict[str, Any]:
    """What was evaluated, for the report: sentences to print, and everything needed to repeat it."""
    header = asdict(predictor.header)
    header["configuration"] = json.loads(predictor.header.configuration)
    return {
        "checkpoint": f"{checkpoint} (epoch {predictor.header.epoch}, {predictor.header.size_px} px)",
        "model": f"{model.name} ({model.sha256[:12]})",
        "fit": f"{config.camera} camera, regularisation {config.regularisation:g} mm^2",
        "hashes": {"checkpoint": sha256(checkpoint.read_bytes()).hexdigest(), "model": model.sha256},
        "configuration": {key: value if value is None else str(value) for key, value in asdict(config).items()},
        "checkpoint_header": header,
        "versions": {
            "pix2face": __version__,
            "python": platform.python_version(),
            **{name: version(name) for name in ("numpy", "scipy", "torch", "matplotlib")},
        },
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """The program."""
    return run_commands("evaluate", DESCRIPTION, {"": evaluate}, arguments)


def _data_folder(config: EvaluateConfig) -> Path | None:
    if config.data is not None:
        return config.data
    folder = os.environ.get(DATA_VARIABLE)
    return Path(folder) if folder else None


def _fit(model: MorphableModel, config: EvaluateConfig, maps: FaceMaps, image_centre: Float64[ndarray, "2"]) -> FaceFit:
    return fit_face(
        maps,
        model,
        camera_kind=config.camera,
        regularisation=config.regularisation,
        principal_point_px=image_centre,
    )


def _evaluate(manifest: Manifest, found: BenchmarkFiles, evaluator: Evaluator, subject: dict[str, Any]) -> Report:
    with progress_bar(Console(stderr=True), f"evaluate {manifest.split}", len(found.items)) as advance:
        results, unreadable = evaluate_faces(found.items, evaluator, advance)
    return make_report(manifest, subject, results, found.missing, (*found.unreadable, *unreadable))


def _check_some_evaluated(report: Report) -> None:
    """Means over no face say nothing: the reasons are all that there is to report."""
    if report.results:
        return
    for face in report.unreadable[:N_WORST]:
        say(Console(stderr=True), f"{face.name}: {face.reason}")
    raise UsageError(
        f"{report.manifest.split}: expected at least one face that can be evaluated, found "
        f"{counted(len(report.unreadable), 'unreadable file')} and nothing else; no report is written"
    )


def _worst_cases(report: Report, found: BenchmarkFiles) -> list[tuple[BenchmarkFace, FaceResult]]:
    items = {item.name: item for item in found.items}
    return [(items[result.name].load(), result) for result in report.worst(N_WORST)]


def _print(console: Console, report: Report, written: Sequence[Path]) -> None:
    console.print(report_table(report))
    for note in (*report_notes(report), f"Written: {', '.join(str(path) for path in written)}"):
        say(console, note)


if __name__ == "__main__":
    raise SystemExit(main())
