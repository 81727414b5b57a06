"""How fast a data set of 300W-LP's size is read: python -m tests.benchmarks.coefficient_files --original FACE.mat.

Makes N copies of one real file with its picture's head, in the folder layout as distributed (four folders, their
``_Flip`` twins, and a ``landmarks/`` folder), in a temporary place; then reads all of them, twice, of which the better
time counts, and converts them into a table. The copies differ in their numbers, so nothing is read from a cache but the
files' own pages.
"""

import io
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

import cv2
import numpy as np
import scipy.io

from pix2face.face_files.w300lp import read_coefficient_file
from tests.benchmarks.measuring import options_parser, write_report

FOLDERS = ("AFW", "HELEN", "IBUG", "LFPW", "AFW_Flip", "HELEN_Flip", "IBUG_Flip", "LFPW_Flip")
FULL_SIZE = 122_450


def make_data_set(root: Path, original: Path, n: int) -> list[Path]:
    """Writes n coefficient files, each with a picture and a landmark file; returns the former."""
    fields = {name: values for name, values in scipy.io.loadmat(original).items() if not name.startswith("__")}
    rng = np.random.default_rng(0)
    picture = cv2.imencode(".jpg", rng.integers(0, 256, (450, 450, 3), dtype=np.uint8))[1].tobytes()[:4096]
    landmarks = io.BytesIO()
    scipy.io.savemat(landmarks, {"pts_2d": fields["pt2d"].T, "pts_3d": fields["pt2d"].T}, do_compression=True)
    paths = []
    for index in range(n):
        folder = FOLDERS[index % len(FOLDERS)]
        path = root / folder / f"{folder}_image_{index // 8:06}_{index // 8 % 8}.mat"
        if index < len(FOLDERS):
            path.parent.mkdir()
            (root / "landmarks" / folder).mkdir(parents=True)
        moved = fields["Shape_Para"] * rng.normal(1, 0.01, fields["Shape_Para"].shape)
        scipy.io.savemat(path, {**fields, "Shape_Para": moved}, do_compression=True)
        path.with_suffix(".jpg").write_bytes(picture)  # its head declares the size; nothing decodes it here
        (root / "landmarks" / folder / f"{path.stem}_pts.mat").write_bytes(landmarks.getvalue())
        paths.append(path)
    return sorted(paths)


def files_per_second(paths: Sequence[Path]) -> float:
    """How many coefficient files are read in a second."""
    seconds = np.inf
    for _ in range(2):
        start = perf_counter()
        for path in paths:
            read_coefficient_file(path)
        seconds = min(seconds, perf_counter() - start)
    return len(paths) / seconds


def measure_conversion(root: Path, model: str, workers: int) -> dict[str, float]:
    """The command itself, in a process of its own: faces a second, peak memory."""
    out = root / "table" / "faces.h5"
    arguments = [
        "coeffs",
        "convert",
        "--from",
        str(root),
        "--out",
        str(out),
        "--model",
        model,
        "--workers",
        str(workers),
    ]
    start = perf_counter()
    command = [
        sys.executable,
        "-c",
        "import sys; from datagen.cli import main; sys.exit(main(sys.argv[1:]))",
        *arguments,
    ]
    subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
    seconds = perf_counter() - start
    # Of the largest of the processes waited for, in KB; the command's own workers are among them.
    peak_mb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    result = {"seconds": seconds, "peak_mb_of_a_process": peak_mb, "table_mb": out.stat().st_size / 2**20}
    shutil.rmtree(out.parent)
    return result


def main() -> None:
    """Measures and writes JSON."""
    parser = options_parser(__doc__)
    parser.add_argument("--original", type=Path, required=True, help="one real file of 300W-LP or AFLW2000-3D")
    parser.add_argument("--n", type=int, default=5000)
    parser.add_argument("--model", help="convert with this model as well: builtin (fits), or an imported BFM (reads)")
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        paths = make_data_set(Path(name), options.original, options.n)
        result: dict[str, object] = {
            "original": options.original.name,
            "files": len(paths),
            "files_per_second": files_per_second(paths),
        }
        if options.model:
            conversion = measure_conversion(Path(name), options.model, options.workers)
            per_file = conversion["seconds"] / len(paths)
            conversion["minutes_for_300wlp_extrapolated"] = per_file * FULL_SIZE / 60
            result["conversion"] = {"model": Path(options.model).name, "workers": options.workers, **conversion}
    write_report(result, options.out)


if __name__ == "__main__":
    main()
