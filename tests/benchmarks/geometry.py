"""How fast faces are evaluated, beside a plain matrix product of the same size in the same run.

    python -m tests.benchmarks.geometry [--vertices 53215] [--faces 256] [--out out/geometry.json]

Prints and writes JSON: seconds a face of both, their ratio, the largest error against float64, and the memory that ten
times as many faces take in batches.
"""

import argparse
import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy import ndarray

from pix2face.models.morphable_model import BATCH_BYTES, MorphableModel
from tests.benchmarks.surroundings import surroundings


def random_model(n_vertices: int, n_identity: int = 199, n_expression: int = 29) -> MorphableModel:
    """A model of BFM's size without meaning."""
    rng = np.random.default_rng(0)

    def numbers(*shape: int) -> ndarray:
        return rng.standard_normal(shape, dtype=np.float32)

    return MorphableModel(
        name="random",
        licence="",
        origin="",
        sha256="",
        mean=80 * numbers(n_vertices, 3),
        identity_basis=0.3 * numbers(n_identity, n_vertices, 3),
        expression_basis=0.3 * numbers(n_expression, n_vertices, 3),
        triangles=np.array([[0, 1, 2]], dtype=np.int32),
        triangle_regions=np.zeros(1, np.uint8),
        region_names=("skin",),
        face_regions=("skin",),
        landmarks={},
        uv=None,
        uv_triangles=None,
        symmetry=None,
        named_expressions={},
    )


def measure(n_vertices: int, n_faces: int, repeats: int = 5) -> dict[str, float]:
    """Times model and product alternately, so that both meet the same machine, and takes the best of each."""
    model, rng = random_model(n_vertices), np.random.default_rng(1)
    identity, expression = rng.standard_normal((n_faces, 199)), rng.standard_normal((n_faces, 29))
    coefficients = np.hstack([identity, expression]).astype(np.float32)
    basis = np.concatenate([model.identity_basis, model.expression_basis]).reshape(228, -1)
    step = max(1, BATCH_BYTES // model.mean.nbytes)

    def product() -> None:
        for start in range(0, n_faces, step):
            coefficients[start : start + step] @ basis

    def faces() -> None:
        for _ in model.vertex_batches(identity, expression):
            pass

    seconds = {"product": np.inf, "model": np.inf}
    for _ in range(repeats):
        seconds["product"] = min(seconds["product"], _seconds(product))
        seconds["model"] = min(seconds["model"], _seconds(faces))
    few = model.vertices(identity[:4], expression[:4])
    exact = np.tensordot(np.hstack([identity, expression])[:4], basis.astype(np.float64), axes=1)
    exact = exact.reshape(few.shape) + model.mean
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in model.vertex_batches(np.tile(identity, (10, 1)), np.tile(expression, (10, 1))):
        pass
    grown_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    return {
        "vertices": n_vertices,
        "faces": n_faces,
        "product_ms_per_face": 1e3 * seconds["product"] / n_faces,
        "model_ms_per_face": 1e3 * seconds["model"] / n_faces,
        "speed_of_product": seconds["product"] / seconds["model"],
        "largest_error_mm": float(np.abs(few - exact).max()),
        "megabytes_more_for_ten_times_the_faces": grown_kb / 1024,
    }


def main() -> int:
    """Measures and writes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--vertices", type=int, default=53215)
    parser.add_argument("--faces", type=int, default=256)
    parser.add_argument("--out", type=Path, default=Path("out/geometry.json"))
    options = parser.parse_args()
    text = json.dumps(measure(options.vertices, options.faces) | {"measured_on": surroundings()}, indent=2)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(text + "\n")
    sys.stdout.write(text + "\n")
    return 0


def _seconds(function: Callable[[], None]) -> float:
    started = time.perf_counter()
    function()
    return time.perf_counter() - started


if __name__ == "__main__":
    sys.exit(main())
