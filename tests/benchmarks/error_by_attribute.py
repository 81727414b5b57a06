"""Landmark errors of a network on shards, by what their samples were drawn from: skin tone, light, what is seen.

    python -m tests.benchmarks.error_by_attribute SHARDS --attribute skin.melanin [--checkpoint C] [--bins 4]

Numbers are divided at their quantiles, so that bins hold about as many samples each (an attribute that a sample lacks
is 0); texts by their values. Errors are % of sqrt(w h) of the true box, mean over the 68 points, with the 95 % interval
of a bootstrap. The shards must be of faces that the network has not been trained on (another `--seed`).
"""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.default_checkpoint import PACKAGED
from pix2face.evaluation.benchmark_shards import read_shard_face
from pix2face.evaluation.evaluator import Evaluator
from pix2face.evaluation.subjects import NetworkSubject
from pix2face.face_maps import FaceMaps
from pix2face.fitting.face_fit import FaceFit, fit_face
from pix2face.fitting.regularisation import PREDICTED_MAPS_REGULARISATION
from pix2face.landmark_file import with_own_landmarks
from pix2face.morphable_model import MorphableModel, builtin_model
from pix2face.predictor import Predictor
from pix2face.shards.shard_reader import ShardReader, shard_paths
from tests.benchmarks.surroundings import surroundings

FACES_AT_ONCE = 16
RESAMPLES = 1000


def measured(folder: Path, checkpoint: Path) -> Iterator[tuple[dict[str, Any], float]]:
    """Attributes and error of each sample; NaN where nothing was found."""
    predictor = Predictor.load(checkpoint)
    model = with_own_landmarks(builtin_model(), predictor.header)
    evaluator = Evaluator(model, NetworkSubject(predictor, partial(_fit, model)), "box-sqrt")
    for path in shard_paths(folder):
        with ShardReader(path) as reader:
            attributes = reader.attributes()
        for first in range(0, len(attributes), FACES_AT_ONCE):
            some = range(first, min(first + FACES_AT_ONCE, len(attributes)))
            results = evaluator.evaluate([read_shard_face(path, index) for index in some])
            yield from ((dict(attributes[index]), own.error()) for index, own in zip(some, results, strict=True))


def _fit(model: MorphableModel, maps: FaceMaps, image_centre: Float64[ndarray, "2"]) -> FaceFit:
    return fit_face(
        maps, model, regularisation=PREDICTED_MAPS_REGULARISATION, principal_point_px=image_centre, silhouette=True
    )


def binned(values: Sequence[str | float], n_bins: int) -> list[str]:
    """The name of the bin that each value lies in."""
    if any(isinstance(value, str) for value in values):
        return [str(value) for value in values]
    numbers = np.array(values, dtype=np.float64)
    edges = np.unique(np.quantile(numbers, np.linspace(0, 1, n_bins + 1)))
    place = np.clip(np.searchsorted(edges, numbers, side="right") - 1, 0, max(len(edges) - 2, 0))
    return [f"{edges[index]:.3g} to {edges[min(index + 1, len(edges) - 1)]:.3g}" for index in place]


def summarise(errors: Float64[ndarray, " n"]) -> dict[str, Any]:
    """Mean with its interval, median and failures of a bin."""
    rng = np.random.default_rng(0)
    means = rng.choice(errors, (RESAMPLES, len(errors))).mean(axis=1)
    low, high = np.quantile(means, [0.025, 0.975])
    return {
        "faces": len(errors),
        "mean": round(100 * float(errors.mean()), 2),
        "interval": [round(100 * float(low), 2), round(100 * float(high), 2)],
        "median": round(100 * float(np.median(errors)), 2),
        "above 10 %": round(100 * float((errors > 0.1).mean()), 1),
    }


def main() -> None:
    """Measures and writes the JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shards", type=Path)
    parser.add_argument("--attribute", action="append", required=True)
    parser.add_argument("--checkpoint", type=Path)
    parser.add_argument("--bins", type=int, default=4)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    found = [(own, error) for own, error in measured(options.shards, options.checkpoint or PACKAGED) if error == error]
    errors = np.array([error for _, error in found])
    report: dict[str, Any] = {"all": summarise(errors)}
    for attribute in options.attribute:
        name, is_size = attribute.removeprefix("abs:"), attribute.startswith("abs:")
        values = [own.get(name, 0.0) for own, _ in found]
        values = [abs(value) for value in values] if is_size else values
        bins = np.array(binned(values, options.bins))
        order = sorted(set(bins.tolist()), key=lambda name: values[bins.tolist().index(name)])
        report[attribute] = {name: summarise(errors[bins == name]) for name in order}
    text = json.dumps({**report, "surroundings": surroundings()}, indent=1)
    sys.stdout.write(text + "\n")
    if options.out:
        options.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
