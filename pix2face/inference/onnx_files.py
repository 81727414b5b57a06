"""Networks as ONNX: opened from checkpoints and from files, run by onnxruntime, written for other programs."""

import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Final, final

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.json_text import Integer, JsonObject, parse_json, typed
from pix2face.inference.answers import Answers, Network
from pix2face.inference.checkpoint import METADATA_KEY, SCHEMA_VERSION, CheckpointHeader, load_weights, unusable
from pix2face.inference.fit_correction import FitCorrection
from pix2face.inference.onnx_graph import OnnxGraph, Shape
from pix2face.inference.onnx_layers import Weights
from pix2face.inference.onnx_networks import (
    face_network,
    feature_shapes,
    residual_decoder,
    residual_encoder,
)
from pix2face.inference.onnx_session import OnnxSession, open_onnx
from pix2face.networks import LANDMARK_NUMBERS, SCALE_PLANE
from pix2face.networks.dimensions import PLANES_IN

INPUT_NAME, OUTPUT_NAME, LANDMARKS_NAME, SEEN_NAME = "image", "maps", "landmarks", "seen"
CORRECTION: Final = "correction."
DESCRIPTION: Final = (
    "image: RGB crop of a face, pixel / 255 - 0.5, (batch, 3, size, size). maps: PNCC x, y, z times pncc_scale_mm and "
    "offset x, y, z times offset_scale_mm are millimetres in the model's frame; a pixel is face where plane 6, "
    "where there is one, is above 0, else where |PNCC| exceeds smallest_radius_mm / 2, eroded by one pixel "
    "(not where the picture ends); plane 7, where there is one, is above 0 where the face is seen; plane 8, where "
    "there is one, is the logarithm of the expected error of PNCC, in its unit. landmarks, where the network "
    "predicts them: x and y from the middle of the crop, and the logarithm of the scale of their error, in units of "
    f"its side. The scales are in the metadata entry {METADATA_KEY!r} (JSON)."
)


def open_network(checkpoint: Path) -> tuple[CheckpointHeader, Network, FitCorrection | None]:
    """Opens a checkpoint of a training, to run on the CPU.

    The plane of scales, which only training needs, is not computed.

    Raises:
        InputFileError: The file is missing, truncated, no checkpoint, or of a newer schema.
    """
    header, arrays = load_weights(checkpoint)
    try:
        graphs, correction = _parts(header, arrays, min(header.planes, SCALE_PLANE))
        return header, _OnnxNetwork(*(OnnxSession(graph.content()) for graph in graphs)), correction
    except ValueError as error:
        raise unusable(checkpoint, error) from error


def export_onnx(checkpoint: Path) -> tuple[CheckpointHeader, bytes]:
    """The network of a checkpoint as an ONNX file, with the checkpoint's header as JSON in its metadata.

    The batch may have any size. The correction of fits is not part of it.

    Returns:
        The header, and the content of the file.

    Raises:
        InputFileError: The checkpoint is missing, truncated, foreign, or of a newer schema.
    """
    header, arrays = _without_correction(checkpoint)
    graph = OnnxGraph()
    try:
        _add_network(graph, header, Weights(arrays), header.planes)
    except ValueError as error:
        raise unusable(checkpoint, error) from error
    return header, graph.content({METADATA_KEY: json.dumps(asdict(header), sort_keys=True)}, DESCRIPTION)


def export_parts(checkpoint: Path) -> tuple[CheckpointHeader, list[bytes]]:
    """The network of a checkpoint as ONNX files to be run one after the other, with weights in float16.

    A network that predicts landmarks has two: the first answers landmarks and what the second needs. The networks
    compute in float32. The plane of scales and the correction of fits are not part of them.

    Returns:
        The header, and the contents of the files.

    Raises:
        InputFileError: The checkpoint is missing, truncated, foreign, or of a newer schema.
    """
    header, arrays = _without_correction(checkpoint)
    try:
        graphs, _ = _parts(header, arrays, min(header.planes, SCALE_PLANE), half=True)
    except ValueError as error:
        raise unusable(checkpoint, error) from error
    return header, [graph.content() for graph in graphs]


def load_onnx(path: Path) -> tuple[CheckpointHeader, Network]:
    """Opens a file of ``export_onnx``, to run on the CPU.

    Raises:
        InputFileError: The file is missing, truncated, not ours, or of a newer schema.
    """
    session = open_onnx(path)
    try:
        fields = parse_json(session.metadata[METADATA_KEY], JsonObject)
        if typed(fields.get("schema_version"), Integer) > SCHEMA_VERSION:
            raise InputFileError(f"{path}: schema {fields['schema_version']} is newer than {SCHEMA_VERSION}; upgrade")
        header = CheckpointHeader.from_json(fields)
        sides = [header.size_px, header.size_px]
        expected = {INPUT_NAME: [PLANES_IN, *sides], OUTPUT_NAME: [header.planes, *sides]}
        if header.n_landmarks:
            expected[LANDMARKS_NAME] = [header.n_landmarks, LANDMARK_NUMBERS]
        if session.shapes != expected:
            raise ValueError("a graph that does not fit its header")
    except (KeyError, ValueError) as error:
        raise InputFileError(f"{path}: expected a network that `pix2face export` wrote, found another one") from error
    return header, _OnnxNetwork(session)


def _without_correction(checkpoint: Path) -> tuple[CheckpointHeader, dict[str, ndarray]]:
    """Header and weights of a checkpoint, as if its network did not correct fits."""
    header, arrays = load_weights(checkpoint)
    kept = {name: values for name, values in arrays.items() if not name.startswith(CORRECTION)}
    return replace(header, n_corrected=0), kept


def _parts(
    header: CheckpointHeader, arrays: Mapping[str, ndarray], planes: int, *, half: bool = False
) -> tuple[list[OnnxGraph], FitCorrection | None]:
    """The graphs of a network, to be run one after the other, and its correction of fits, if it has one.

    Those of a network that predicts landmarks are its two halves.

    Raises:
        ValueError: The weights are not those of the network.
    """
    weights, encoder = Weights(arrays), OnnxGraph(half=half)
    if not header.n_landmarks:
        return [encoder], _add_network(encoder, header, weights, planes)
    decoder = OnnxGraph(half=half)
    image = encoder.input(INPUT_NAME, ("batch", PLANES_IN, header.size_px, header.size_px))
    features, found = residual_encoder(encoder, image, weights, header)
    inputs = []
    for number, (name, shape) in enumerate(zip(features, feature_shapes(header), strict=True)):
        encoder.output(f"features{number}", name, ("batch", *shape))
        inputs.append(decoder.input(f"features{number}", ("batch", *shape)))
    _add_outputs(encoder, found, header, planes)
    _add_outputs(decoder, residual_decoder(decoder, inputs, weights, header, planes), header, planes)
    correction = _correction(weights, header)
    weights.check_empty()
    return [encoder, decoder], correction


def _add_network(graph: OnnxGraph, header: CheckpointHeader, weights: Weights, planes: int) -> FitCorrection | None:
    """Adds the whole network of a checkpoint to a graph, and returns its correction of fits, if it has one.

    Raises:
        ValueError: The weights are not those of the network.
    """
    image = graph.input(INPUT_NAME, ("batch", PLANES_IN, header.size_px, header.size_px))
    found = face_network(graph, image, weights, header, planes)
    correction = _correction(weights, header)
    weights.check_empty()
    _add_outputs(graph, found, header, planes)
    return correction


def _correction(weights: Weights, header: CheckpointHeader) -> FitCorrection | None:
    return FitCorrection.of(weights, header.n_corrected) if header.n_corrected else None


def _add_outputs(graph: OnnxGraph, found: Mapping[str, str], header: CheckpointHeader, planes: int) -> None:
    shapes: dict[str, tuple[str, Shape]] = {
        "planes": (OUTPUT_NAME, (planes, header.size_px, header.size_px)),
        "landmarks": (LANDMARKS_NAME, (header.n_landmarks, LANDMARK_NUMBERS)),
        "seen": (SEEN_NAME, ("features",)),
    }
    for kind, value in found.items():
        name, shape = shapes[kind]
        graph.output(name, value, ("batch", *shape))


@final
class _OnnxNetwork:
    """A ``Network`` that onnxruntime runs.

    Args:
        first: The whole network, or its encoder.
        second: Its decoder, if the first is the encoder.
    """

    def __init__(self, first: OnnxSession, second: OnnxSession | None = None) -> None:
        self._first, self._second = first, second

    def answers(self, pictures: Float32[ndarray, "b s s 3"]) -> Answers:
        found = self._encoded(pictures)
        if self._second is not None:
            landmarks = found.pop(LANDMARKS_NAME)
            found = self._second.run(found) | {LANDMARKS_NAME: landmarks}
        planes = np.ascontiguousarray(found[OUTPUT_NAME].transpose(0, 2, 3, 1))
        return Answers(planes, found.get(LANDMARKS_NAME), found.get(SEEN_NAME))

    def landmarks(self, pictures: Float32[ndarray, "b s s 3"]) -> Float32[ndarray, "b n 3"]:
        return self._encoded(pictures)[LANDMARKS_NAME]

    def _encoded(self, pictures: Float32[ndarray, "b s s 3"]) -> dict[str, Float32[ndarray, "..."]]:
        return self._first.run({INPUT_NAME: np.ascontiguousarray(pictures.transpose(0, 3, 1, 2))})
