"""Writes an evaluation: ``report.json``, one page, the pictures on it, and the landmarks that were found."""

import json
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFace
from pix2face.evaluation.evaluator import FaceResult
from pix2face.evaluation.report.evaluation_report import Report
from pix2face.evaluation.report.report_json import report_as_json
from pix2face.evaluation.report.report_page import picture_html, report_page
from pix2face.evaluation.report.report_pictures import curve3d_png, curve_png, face_svg
from pix2face.evaluation.report.report_text import all_cells, report_notes
from pix2face.evaluation.report.worst_cases import cases_sheet
from pix2face.evaluation.subjects.predictions_file import PredictedLandmarks, write_predictions

Cases = Sequence[tuple[BenchmarkFace, FaceResult]]
CAPTION = "Green: true landmarks. Red: found landmarks."


def write_report(
    report: Report, worst: Cases, best: Cases, frontal_face: Float64[ndarray, "68 2"], folder: Path
) -> list[Path]:
    """Writes ``index.html``, ``report.json``, ``landmarks.npz``, ``curve.png``, ``worst.jpg`` and ``best.jpg``.

    Args:
        report: The evaluation.
        worst: The worst cases with their pictures, worst first.
        best: The best cases, best first.
        frontal_face: The mean face's landmarks seen from the front, to draw errors on.
        folder: Where they go; made where it is not there.

    Returns:
        The files written.

    Raises:
        UsageError: The folder cannot be written to.
    """
    contents = {
        "report.json": json.dumps(report_as_json(report), indent=1, allow_nan=False).encode(),
        "curve.png": curve_png(report),
        "worst.jpg": _jpeg(cases_sheet(worst)),
        "best.jpg": _jpeg(cases_sheet(best)),
    }
    in_space = curve3d_png(report)
    if in_space is not None:
        contents["curve3d.png"] = in_space
    contents["index.html"] = _page(report, contents, frontal_face).encode()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in contents.items():
            (folder / name).write_bytes(content)
        _write_landmarks(report, folder / "landmarks.npz")
    except OSError as error:
        raise UsageError(f"{folder}: expected a folder that the report can be written to ({error.strerror})") from error
    return [folder / name for name in (*contents, "landmarks.npz")]


def _page(report: Report, contents: dict[str, bytes], frontal_face: Float64[ndarray, "68 2"]) -> str:
    method = report.settings.method
    sections = [("Error curve", "", picture_html(contents["curve.png"], "png", "Cumulative error distribution"))]
    if "curve3d.png" in contents:
        picture = picture_html(contents["curve3d.png"], "png", "Cumulative distribution of distances in 3D")
        sections.append(("Error curve in 3D", "", picture))
    drawn = face_svg(report.mean_of_landmarks(method), frontal_face)
    sentence = f"Row {method}: area and colour by the mean error; point at a disc for its number (from 1) and figure."
    sections.append(("Error of each landmark", sentence, drawn))
    for heading, name in (("Worst cases", "worst.jpg"), ("Best cases", "best.jpg")):
        sections.append((heading, CAPTION, picture_html(contents[name], "jpeg", heading)))
    return report_page(report.manifest.title, all_cells(report), report_notes(report), sections)


def _write_landmarks(report: Report, path: Path) -> None:
    """What was found, as other systems hand it in: so that it can be measured again by other rules."""
    if not report.results:
        path.unlink(missing_ok=True)
        return
    nothing, no_pose = np.full((68, 2), np.nan), np.full(3, np.nan)
    landmarks = [nothing if result.landmarks2d is None else result.landmarks2d for result in report.results]
    poses = [no_pose if result.pose_deg is None else result.pose_deg for result in report.results]
    has_pose = any(result.pose_deg is not None for result in report.results)
    names = tuple(result.name for result in report.results)
    pose_deg = np.stack(poses) if has_pose else None
    write_predictions(
        path, PredictedLandmarks(source=path, names=names, landmarks2d=np.stack(landmarks), pose_deg=pose_deg)
    )


def _jpeg(image: UInt8[ndarray, "h w 3"]) -> bytes:
    return bytes(cv2.imencode(".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1])
