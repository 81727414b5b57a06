"""Networks as ONNX: opened from checkpoints and from files, run by onnxruntime, written for other programs."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Final, final

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from pix2face.inference.answers import Answers, Network
from pix2face.inference.checkpoint import METADATA_KEY, SCHEMA_VERSION, CheckpointHeader, load_weights
from pix2face.inference.fit_correction import FitCorrection
from pix2face.inference.onnx_graph import OnnxGraph
from pix2face.inference.onnx_networks import INPUT_NAME, LANDMARKS_NAME, OUTPUT_NAME, SEEN_NAME, add_network
from pix2face.inference.onnx_session import OnnxSession, open_onnx
from pix2face.inference.weight_files import Weights, header_fits_weights, header_in
from pix2face.networks import LANDMARK_NUMBERS, SCALE_PLANE
from pix2face.networks.dimensions import PLANES_IN

CORRECTION: Final = "correction."
DESCRIPTION: Final = (
    "image: RGB crop of a face, pixel / 255 - 0.5, (batch, 3, size, size). maps: PNCC x, y, z times pncc_scale_mm and "
    "offset x, y, z times offset_scale_mm are millimetres in the model's frame; a pixel is face where plane 6, "
    "where there is one, is above 0, else where |PNCC| exceeds smallest_radius_mm / 2; both eroded by one pixel "
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
    weights = Weights(arrays)
    with header_fits_weights(checkpoint, "network"):
        graphs = _parts(header, weights, half=False)
        correction = FitCorrection.of(weights, header.n_corrected) if header.n_corrected else None
        weights.check_empty()
        network = _OnnxNetwork(*(OnnxSession(graph.content()) for graph in graphs))
    return header, network, correction


def export_onnx(checkpoint: Path) -> tuple[CheckpointHeader, bytes]:
    """The network of a checkpoint as an ONNX file, with the checkpoint's header as JSON in its metadata.

    The batch may have any size. The correction of fits is not part of it.

    Returns:
        The header, and the content of the file.

    Raises:
        InputFileError: The checkpoint is missing, truncated, foreign, or of a newer schema.
    """
    header, weights = _without_correction(checkpoint)
    graph = OnnxGraph()
    with header_fits_weights(checkpoint, "network"):
        add_network((graph, graph), weights, header, header.planes)
        weights.check_empty()
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
    header, weights = _without_correction(checkpoint)
    with header_fits_weights(checkpoint, "network"):
        graphs = _parts(header, weights, half=True)
        weights.check_empty()
    return header, [graph.content() for graph in graphs]


def _without_correction(checkpoint: Path) -> tuple[CheckpointHeader, Weights]:
    """Header and weights of a checkpoint, as if its network did not correct fits."""
    header, arrays = load_weights(checkpoint)
    kept = {name: values for name, values in arrays.items() if not name.startswith(CORRECTION)}
    return replace(header, n_corrected=0), Weights(kept)


def _parts(header: CheckpointHeader, weights: Weights, *, half: bool) -> list[OnnxGraph]:
    """The graphs of a network without the plane of scales, to be run one after the other.

    Those of a network that predicts landmarks are its two halves, since landmarks alone take the first one only.

    Raises:
        ValueError: The weights are not those of the network.
    """
    first = OnnxGraph(half=half)
    second = OnnxGraph(half=half) if header.n_landmarks else first
    add_network((first, second), weights, header, min(header.planes, SCALE_PLANE))
    return [first] if second is first else [first, second]


def load_onnx(path: Path) -> tuple[CheckpointHeader, Network]:
    """Opens a file of ``export_onnx``, to run on the CPU.

    Raises:
        InputFileError: The file is missing, truncated, not ours, or of a newer schema.
    """
    session = open_onnx(path)
    fields = header_in(session.metadata, path, METADATA_KEY, SCHEMA_VERSION)
    with header_fits_weights(path, "network"):
        header = CheckpointHeader.from_json(fields)
        sides = [header.size_px, header.size_px]
        expected = {INPUT_NAME: [PLANES_IN, *sides], OUTPUT_NAME: [header.planes, *sides]}
        if header.n_landmarks:
            expected[LANDMARKS_NAME] = [header.n_landmarks, LANDMARK_NUMBERS]
        if session.shapes != expected:
            raise ValueError("inputs and outputs are not those of the header")
    return header, _OnnxNetwork(session)


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
