"""Prints how far good annotations stay from the limits beyond which faces are refused.

python -m tests.benchmarks.good_faces FOLDER ... [--model builtin]
"""

import argparse
from dataclasses import asdict
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from datagen.faces.fit_landmark_folder import LARGEST_RESIDUAL, AnnotatedFaceFitter, relative_residual
from pix2face.errors import DegenerateGeometryError, InputFileError
from pix2face.face_files.annotations import find_annotations
from pix2face.face_files.point_checks import LEAST_PRESENT, SMALLEST_FACE_PX
from pix2face.files.images import read_size_px
from pix2face.geometry.believable_face import PROJECTED, SET_BY_HAND, measure_face
from pix2face.models.morphable_model import open_model

PERCENTILES = (0, 1, 50, 99, 100)


def measure(folder: Path, model_name: str) -> list[str]:
    """What was refused, a table for the faces that were set by hand, and one for those projected from a model."""
    fitter, lines = AnnotatedFaceFitter.of(open_model(model_name)), []
    rows: dict[bool, list[dict[str, float]]] = {True: [], False: []}
    for annotation in find_annotations(folder):
        try:
            face = annotation.load()
            fit = fitter.fit(face)
        except (InputFileError, DegenerateGeometryError) as error:
            lines.append(f"refused: {annotation.name}: {error}")
            continue
        coefficients = np.concatenate([fit.identity, fit.expression])
        measures = measure_face(fit.camera, coefficients, fit.landmarks2d, read_size_px(face.image_path))
        limits = SET_BY_HAND if face.follows_outline else PROJECTED
        lines += [f"refused: {annotation.name}: {problem}" for problem in measures.problems(limits)]
        present = face.landmarks2d[np.isfinite(face.landmarks2d).all(axis=1)]
        others = {
            "missing": 1 - len(present) / len(face.landmarks2d),
            "extent_px": float(np.ptp(present, axis=0).max()),
            "residual": relative_residual(fit, face, np.median),
        }
        rows[face.follows_outline].append({**asdict(measures), **others})
    for by_hand, found in rows.items():
        if found:
            lines += table(f"{folder.name}, {'set by hand' if by_hand else 'projected'}", found, by_hand)
    return lines


def table(title: str, rows: list[dict[str, float]], by_hand: bool) -> list[str]:
    """Percentiles of each measure, and its limit."""
    limits = {**asdict(SET_BY_HAND if by_hand else PROJECTED), "residual": LARGEST_RESIDUAL}
    limits |= {"missing": 1 - LEAST_PRESENT, "extent_px": SMALLEST_FACE_PX}
    lines = [f"{title}: {len(rows)} faces", f"{'':20}" + "".join(f"{f'{p} %':>9}" for p in PERCENTILES) + "    limit"]
    for name in rows[0]:
        values = np.percentile([row[name] for row in rows], PERCENTILES)
        limit = f"{limits[name]:9.2f}" if name in limits else ""
        lines.append(f"{name:20}" + "".join(f"{value:9.3f}" for value in values) + limit)
    return lines


def main() -> None:
    """Measures each folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    parser.add_argument("--model", default="builtin")
    options = parser.parse_args()
    with threadpool_limits(1, user_api="blas"):  # small systems: threads would only wait for each other
        lines = [line for folder in options.folders for line in measure(folder, options.model)]
    print("\n".join(lines))  # noqa: T201


if __name__ == "__main__":
    main()
