"""Files of the face detector's network: weights as safetensors with one JSON header, or ONNX; run by onnxruntime."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Final, final

import msgspec
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from pix2face.files.json_text import JsonObject, typed
from pix2face.inference.onnx_graph import OnnxGraph
from pix2face.inference.onnx_layers import Layers
from pix2face.inference.onnx_session import OnnxSession, open_onnx
from pix2face.inference.weight_files import Weights, header_fits_weights, header_in, read_arrays, read_header
from pix2face.networks.dimensions import CENTRE_NECK, CENTRE_PLANES, CENTRE_WIDTHS, MOST_FILTERS, PLANES_IN

METADATA_KEY = "pix2face-detector"
SCHEMA_VERSION = 1
INPUT_NAME: Final = "pictures"
OUTPUT_NAME: Final = "cells"
Filters = Annotated[int, msgspec.Meta(ge=1, le=MOST_FILTERS)]
# From pictures to the planes of each cell (``pix2face.networks.dimensions.CENTRE_PLANES``).
CentreAnswers = Callable[[UInt8[ndarray, "b h w 3"]], Float32[ndarray, "b y x 5"]]


@final
@dataclass(frozen=True, kw_only=True)
class DetectorHeader:
    """What is needed to use the weights, and where they come from."""

    widths: tuple[Filters, ...] = CENTRE_WIDTHS  # filters of each level
    neck: Filters = CENTRE_NECK  # filters of the pyramid
    licence: str  # terms that the training data put on the weights
    configuration: str  # of the training, as JSON
    samples: int  # scenes seen in training
    schema_version: int = SCHEMA_VERSION


def load_detector(path: Path) -> tuple[DetectorHeader, CentreAnswers]:
    """Opens what ``train detector`` wrote, or ``pix2face export --detector`` (.onnx).

    Raises:
        InputFileError: The file is missing, truncated, of another kind, or of a newer schema.
    """
    if path.suffix.lower() != ".onnx":
        header, graph = _read(path, half=False)
        return header, _runner(OnnxSession(graph.content()))
    session = open_onnx(path)
    header = _typed(path, header_in(session.metadata, path, METADATA_KEY, SCHEMA_VERSION))
    with header_fits_weights(path, "detector"):
        if session.shapes.keys() != {INPUT_NAME, OUTPUT_NAME}:
            raise ValueError(f"expected {INPUT_NAME} and {OUTPUT_NAME}, found {', '.join(session.shapes)}")
    return header, _runner(session)


def export_detector(detector: Path, *, half: bool = False) -> bytes:
    """A detector that ``train detector`` wrote as an ONNX file, for any number of pictures of any size.

    Args:
        detector: Its file.
        half: Whether weights are stored in float16. The network computes in float32.

    Raises:
        InputFileError: The detector is missing or unusable.
    """
    header, graph = _read(detector, half=half)
    return graph.content({METADATA_KEY: json.dumps(asdict(header), sort_keys=True)})


def detector_header(path: Path) -> DetectorHeader:
    """Reads what a detector says of itself, without its weights.

    Raises:
        InputFileError: The file is missing, truncated, of another kind, or of a newer schema.
    """
    return _typed(path, read_header(path, METADATA_KEY, SCHEMA_VERSION))


def _typed(path: Path, fields: JsonObject) -> DetectorHeader:
    with header_fits_weights(path, "detector"):
        header: DetectorHeader = typed(fields, DetectorHeader)
    return header


def _read(path: Path, *, half: bool) -> tuple[DetectorHeader, OnnxGraph]:
    header, graph = detector_header(path), OnnxGraph(half=half)
    pictures = graph.input(INPUT_NAME, ("batch", PLANES_IN, "height", "width"))
    weights = Weights(read_arrays(path))
    with header_fits_weights(path, "detector"):
        cells = _network(graph, pictures, weights, header.widths, header.neck)
        weights.check_empty()
    graph.output(OUTPUT_NAME, cells, ("batch", CENTRE_PLANES, "rows", "columns"))
    return header, graph


def _network(graph: OnnxGraph, pictures: str, weights: Weights, widths: Sequence[int], neck: int) -> str:
    """Adds ``training.detection.centre_network.CentreNetwork`` to a graph.

    Raises:
        ValueError: An array is missing or has another shape.
    """
    layers = Layers(graph, weights)

    def layer(x: str, name: str, before: int, after: int, stride: int = 1) -> str:
        return layers.relu(layers.convolution(x, f"{name}.0", before, after, 3, stride=stride, norm=f"{name}.1"))

    def residual(x: str, name: str, width: int) -> str:
        inner = layers.convolution(x, f"{name}.inner.0", width, width, 3, norm=f"{name}.inner.1")
        change = layers.convolution(layers.relu(inner), f"{name}.inner.3", width, width, 3, norm=f"{name}.inner.4")
        return layers.relu(layers.add(x, change))

    def side(x: str, name: str, before: int) -> str:
        return layers.convolution(x, f"{name}.0", before, neck, 1, norm=f"{name}.1")

    at2, at4, at8, at16, at32 = widths
    quarter = layer(layer(pictures, "to4.0", PLANES_IN, at2, 2), "to4.1", at2, at4, 2)
    eighth = residual(layer(quarter, "to8.0", at4, at8, 2), "to8.1", at8)
    sixteenth = layer(eighth, "to16.0", at8, at16, 2)
    for name in ("to16.1", "to16.2"):
        sixteenth = residual(sixteenth, name, at16)
    coarse = side(residual(layer(sixteenth, "to32.0", at16, at32, 2), "to32.1", at32), "side32", at32)
    for name, x, width in (("16", sixteenth, at16), ("8", eighth, at8)):
        both = layers.relu(layers.add(side(x, f"side{name}", width), layers.enlarged(coarse, 2, "nearest")))
        coarse = layer(both, f"mixed{name}", neck, neck)
    return layers.convolution(coarse, "answer", neck, CENTRE_PLANES, 1, has_bias=True)


def _runner(session: OnnxSession) -> CentreAnswers:
    def answers(pictures: UInt8[ndarray, "b h w 3"]) -> Float32[ndarray, "b y x 5"]:
        batch = np.ascontiguousarray(pictures.transpose(0, 3, 1, 2), dtype=np.float32) / 255 - np.float32(0.5)
        return np.ascontiguousarray(session.run({INPUT_NAME: batch})[OUTPUT_NAME].transpose(0, 2, 3, 1))

    return answers
