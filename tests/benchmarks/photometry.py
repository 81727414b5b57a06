"""Brightness, contrast and colour of faces in pictures: of synthetic ones beside those of photographs.

    python -m tests.benchmarks.photometry SHARDS... [--where CONDITION] [--most 1000] [--out photometry.json]

Shards of photographs are what `datagen render` makes of coefficients with their pictures. A face is its mask, where it
is seen if the shards say so (of photographs, hair over the forehead counts as face). Faces of fewer than 200 pixels are
left out, and pictures without colour from the figures of colour.
"""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.shards.sample_filter import SampleFilter
from pix2face.shards.shard_reader import ShardReader, shard_paths
from tests.benchmarks.measuring import options_parser, write_report

LEAST_PIXELS = 200
# Bytes by which a channel must lead.
LEAD = 2
QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


def face_colours(folder: Path, where: str, most: int) -> Float64[ndarray, "n 4"]:
    """Mean red, green and blue of each face, and the deviation of its pixels (the mean over the channels), bytes."""
    chosen, found = SampleFilter(where, "--where") if where else None, []
    for path in shard_paths(folder):
        reader = ShardReader(path)
        for index, attributes in enumerate(reader.attributes()):
            if chosen is not None and not chosen.passes(reader.sample_ids[index], attributes):
                continue
            layers = reader.read(index).layers
            face = layers["mask"].astype(bool) & (layers.get("seen", layers["mask"]) > 0)
            if np.count_nonzero(face) < LEAST_PIXELS:
                continue
            pixels = reader.read(index).image[face].astype(np.float64)
            found.append([*pixels.mean(axis=0), pixels.std(axis=0).mean()])
            if len(found) == most:
                return np.array(found)
    return np.array(found).reshape(-1, 4)


def summarise(faces: Float64[ndarray, "n 4"]) -> dict[str, Any]:
    """Quantiles of brightness, contrast and warmth, and the shares of odd colours."""
    if not len(faces):
        return {"faces": 0}
    red, green, blue, deviation = faces.T
    coloured = np.abs(red - blue) >= LEAD

    def quantiles(values: Float64[ndarray, " n"]) -> list[float]:
        return [round(float(value), 2) for value in np.quantile(values, QUANTILES)]

    return {
        "faces": len(faces),
        "without colour": round(1 - float(coloured.mean()), 4),
        "brightness": quantiles(faces[:, :3].mean(axis=1)),
        "deviation within the face": quantiles(deviation),
        "red over blue": quantiles((red / np.maximum(blue, 1))[coloured]),
        "more blue than red": round(float((blue > red + LEAD).mean()), 4),
        "more blue than green": round(float((blue > green + LEAD).mean()), 4),
        "more green than red": round(float((green > red + LEAD).mean()), 4),
    }


def main() -> None:
    """Measures each folder and writes the JSON."""
    parser = options_parser(__doc__)
    parser.add_argument("shards", type=Path, nargs="+")
    parser.add_argument("--where", default="")
    parser.add_argument("--most", type=int, default=1000)
    options = parser.parse_args()
    measured = {str(folder): summarise(face_colours(folder, options.where, options.most)) for folder in options.shards}
    write_report({"quantiles": QUANTILES, "sets": measured}, options.out)


if __name__ == "__main__":
    main()
