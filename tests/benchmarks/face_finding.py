"""How well a detector finds faces, by yaw and size, what else it takes for faces, and how long it takes.

    python -m tests.benchmarks.face_finding [--detector cnn | --network FILE] [--min-score 1] [--annotated FOLDER ...]
        [--empty FOLDER ...] [--clips FILE ...] [--time] [--sheets FOLDER] [--out out/face_finding.json]

Prints and writes JSON. A face is found if the centre of a box lies in its own box and their longer sides differ by at
most a factor of 2; a box that finds no annotated face is false, also if it is somebody's whom nobody annotated: look at
``--sheets`` (annotated blue, found green, doubtful orange). Folders of ``--empty`` show no face. Times are of one core,
from the decoded picture to boxes.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

import cv2
import numpy as np
from numpy import ndarray

from pix2face.detectors import SURE_SCORE
from pix2face.detectors.centre_detector import CentreDetector
from pix2face.detectors.detection import open_detector
from pix2face.detectors.protocol import DetectedFace, overlap
from pix2face.face_files.annotations import find_annotations
from pix2face.face_files.w300lp import read_coefficient_file
from pix2face.files.images import IMAGE_SUFFIXES, read_photograph
from pix2face.geometry.crops import FaceBox
from pix2face.inference.onnx_session import keep_networks_in_one_thread
from pix2face.tracking.video import open_frames
from tests.benchmarks.measuring import options_parser, processor_ms, write_report

Find = Callable[[ndarray], Sequence[DetectedFace]]
YAWS = {"to 30": (0.0, 30.0), "to 60": (30.0, 60.0), "above": (60.0, 181.0)}
SIZES = {"below 32 px": (0.0, 32.0), "to 64 px": (32.0, 64.0), "to 128 px": (64.0, 128.0), "above": (128.0, 1e9)}
SCORES = (0.5, 0.75, 1.0, 1.25, 1.5)  # of the curve of recall and false boxes
TIMED = ((450, 450), (720, 1280), (3000, 4000))
TILE_PX, COLUMNS = 220, 8


@final
@dataclass(frozen=True, eq=False)
class Seen:
    """A photograph, its annotated faces with their absolute yaw (NaN if unknown), and what was found."""

    path: Path
    faces: Sequence[FaceBox]
    yaws_deg: Sequence[float]
    found: Sequence[DetectedFace]


def is_hit(box: FaceBox, face: FaceBox) -> bool:
    """Whether a box finds a face."""
    x, y = box.centre
    ratio = box.longer_side / face.longer_side
    return face.left <= x <= face.right and face.top <= y <= face.bottom and 0.5 <= ratio <= 2


def annotated_photographs(folder: Path) -> dict[Path, list[tuple[FaceBox, float]]]:
    """The faces of each annotated photograph of a folder, with their absolute yaw where a coefficient file has it."""
    faces: dict[Path, list[tuple[FaceBox, float]]] = {}
    for annotation in find_annotations(folder):
        annotated = annotation.load()
        has_yaw = annotation.path.suffix == ".mat"
        yaw = abs(read_coefficient_file(annotation.path).pose.head.yaw_deg) if has_yaw else float("nan")
        faces.setdefault(annotated.image_path, []).append((FaceBox.around(annotated.landmarks2d), yaw))
    return faces


def look(find: Find, photographs: Mapping[Path, Sequence[tuple[FaceBox, float]]]) -> list[Seen]:
    """Searches photographs."""
    return [
        Seen(path, [box for box, _ in faces], [yaw for _, yaw in faces], find(read_photograph(path)))
        for path, faces in photographs.items()
    ]


def figures(seen: Sequence[Seen], min_score: float) -> dict[str, object]:
    """Faces found, by yaw and size, false boxes and overlaps at a score; and the curve over scores."""
    hits, overlaps, n_false = _hits(seen, min_score)
    yaws = np.array([yaw for own in seen for yaw in own.yaws_deg])
    sides = np.array([face.longer_side for own in seen for face in own.faces])
    return {
        "photographs": len(seen),
        "found": _share(hits),
        "by_yaw": {name: _share(hits[(yaws >= low) & (yaws < high)]) for name, (low, high) in YAWS.items()},
        "by_size": {name: _share(hits[(sides >= low) & (sides < high)]) for name, (low, high) in SIZES.items()},
        "false_boxes": n_false,
        "overlap_median": round(float(np.median(overlaps)), 3) if overlaps else None,
        "overlap_lowest_tenth": round(float(np.percentile(overlaps, 10)), 3) if overlaps else None,
        "curve": {f"{score:g}": [int(_hits(seen, score)[0].sum()), _hits(seen, score)[2]] for score in SCORES},
    }


def _hits(seen: Sequence[Seen], min_score: float) -> tuple[ndarray, list[float], int]:
    hits, overlaps, n_false = [], [], 0
    for own in seen:
        boxes = [face.box for face in own.found if face.score >= min_score]
        for face in own.faces:
            close = [overlap(box, face) for box in boxes if is_hit(box, face)]
            hits.append(bool(close))
            overlaps += [max(close)] if close else []
        n_false += sum(not any(is_hit(box, face) for face in own.faces) for box in boxes)
    return np.array(hits, dtype=bool), overlaps, n_false


def _share(hits: ndarray) -> list[int]:
    return [int(hits.sum()), len(hits)]


def clip_figures(find: Find, path: Path, min_score: float) -> dict[str, object]:
    """In how many frames of a clip how many faces were found."""
    counts = [sum(face.score >= min_score for face in find(image)) for image in open_frames(path).frames()]
    return {"frames": len(counts), "frames_by_number_of_faces": np.bincount(counts).tolist()}


def times_ms(find: Find) -> dict[str, float]:
    """Milliseconds of one core for pictures of noise, the median of nine."""
    results = {}
    for height, width in TIMED:
        image = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
        (times,) = processor_ms({"find": lambda image=image: find(image)}, 9).values()
        results[f"{width} x {height}"] = round(float(np.median(times)), 1)
    return results


def write_sheets(seen: Sequence[Seen], min_score: float, folder: Path, name: str) -> None:
    """Pictures of the photographs with a miss, and of those with a false box."""
    folder.mkdir(parents=True, exist_ok=True)
    for kind, is_shown in (("misses", _has_miss), ("false", _has_false)):
        tiles = [_tile(own, min_score) for own in seen if is_shown(own, min_score)]
        tiles += [np.zeros((TILE_PX, TILE_PX, 3), np.uint8)] * (-len(tiles) % COLUMNS)
        rows = [np.hstack(tiles[start : start + COLUMNS]) for start in range(0, len(tiles), COLUMNS)]
        if rows:
            cv2.imwrite(str(folder / f"{name}_{kind}.png"), np.vstack(rows)[..., ::-1])


def _has_miss(own: Seen, min_score: float) -> bool:
    return not _hits([own], min_score)[0].all()


def _has_false(own: Seen, min_score: float) -> bool:
    return _hits([own], min_score)[2] > 0


def _tile(own: Seen, min_score: float) -> ndarray:
    image = read_photograph(own.path)
    scale = TILE_PX / max(image.shape[:2])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    for face in own.faces:
        _outline(small, face, scale, (60, 90, 255))
    for found in own.found:
        if found.score >= min_score / 2:
            _outline(small, found.box, scale, (0, 255, 0) if found.score >= min_score else (255, 160, 0))
    tile = np.zeros((TILE_PX, TILE_PX, 3), dtype=np.uint8)
    tile[: small.shape[0], : small.shape[1]] = small[:TILE_PX, :TILE_PX]
    return tile


def _outline(image: ndarray, box: FaceBox, scale: float, colour: tuple[int, int, int]) -> None:
    left, top, right, bottom = (round(scale * value) for value in (box.left, box.top, box.right, box.bottom))
    cv2.rectangle(image, (left, top), (right, bottom), colour, 1)


def _sets(options: argparse.Namespace) -> Iterator[tuple[str, Mapping[Path, Sequence[tuple[FaceBox, float]]]]]:
    for folder in options.annotated:
        yield folder.name, annotated_photographs(folder)
    for folder in options.empty:
        paths = [folder] if folder.is_file() else sorted(folder.rglob("*"))
        yield folder.stem, {path: [] for path in paths if path.suffix.lower() in IMAGE_SUFFIXES}


def main() -> None:
    """Measures and writes."""
    parser = options_parser(__doc__, Path("out/face_finding.json"))
    parser.add_argument("--detector", default="cnn")
    parser.add_argument("--network", type=Path, help="a detector that `train detector` wrote")
    parser.add_argument("--min-score", type=float, default=SURE_SCORE)
    parser.add_argument("--annotated", type=Path, nargs="*", default=[])
    parser.add_argument("--empty", type=Path, nargs="*", default=[])
    parser.add_argument("--clips", type=Path, nargs="*", default=[])
    parser.add_argument("--time", action="store_true")
    parser.add_argument("--sheets", type=Path)
    options = parser.parse_args()
    keep_networks_in_one_thread()
    cv2.setNumThreads(1)
    find = (CentreDetector.load(options.network) if options.network else open_detector(options.detector)).candidates
    report: dict[str, object] = {"min_score": options.min_score}
    for name, photographs in _sets(options):
        seen = look(find, photographs)
        report[name] = figures(seen, options.min_score)
        if options.sheets:
            write_sheets(seen, options.min_score, options.sheets, name)
    report |= {path.name: clip_figures(find, path, options.min_score) for path in options.clips}
    report |= {"milliseconds": times_ms(find)} if options.time else {}
    write_report(report, options.out)


if __name__ == "__main__":
    main()
