"""Files of the face detector's network: weights as safetensors with one JSON header, or ONNX, run by NumPy arrays."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import final

import numpy as np
import torch
from jaxtyping import Float32, UInt8
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.json_text import typed
from pix2face.inference.checkpoint import read_header, read_tensors, write_tensors
from pix2face.networks.centre import NECK, WIDTHS, CentreNetwork, folded

METADATA_KEY = "pix2face-detector"
SCHEMA_VERSION = 1
# From pictures to the five planes of each cell (``pix2face.networks.centre``).
CentreAnswers = Callable[[UInt8[ndarray, "b h w 3"]], Float32[ndarray, "b y x 5"]]


@final
@dataclass(frozen=True, kw_only=True)
class DetectorHeader:
    """What is needed to use the weights, and where they come from."""

    widths: tuple[int, ...] = WIDTHS  # filters of each level
    neck: int = NECK  # filters of the pyramid
    licence: str  # terms that the training data put on the weights
    configuration: str  # of the training, as JSON
    samples: int  # scenes seen in training
    schema_version: int = SCHEMA_VERSION


def save_detector(path: Path, header: DetectorHeader, network: CentreNetwork, precision: torch.dtype) -> None:
    """Writes a network; a file of that name is replaced at once or not at all. Norms and biases stay float32."""
    tensors = {
        name: tensor.to(precision) if tensor.ndim > 1 else tensor for name, tensor in network.state_dict().items()
    }
    write_tensors(path, METADATA_KEY, asdict(header), tensors)


def load_detector(path: Path) -> tuple[DetectorHeader, CentreAnswers]:
    """Opens what ``save_detector`` wrote, or ``export_detector`` (.onnx); see ``load_centre_network``."""
    if path.suffix.lower() == ".onnx":
        from pix2face.inference.centre_onnx import load_detector_onnx

        return load_detector_onnx(path)
    header, network = load_centre_network(path)
    return header, runner(network)


def load_centre_network(path: Path) -> tuple[DetectorHeader, CentreNetwork]:
    """Reads what ``save_detector`` wrote; the network computes in float32, whatever its file is in.

    Raises:
        InputFileError: The file is missing, truncated, of another kind, or of a newer schema.
    """
    fields = read_header(path, METADATA_KEY, SCHEMA_VERSION)
    try:
        header: DetectorHeader = typed(fields, DetectorHeader)
        network = CentreNetwork(header.widths, header.neck)
        network.load_state_dict({name: _single(value) for name, value in read_tensors(path).items()})
    except (TypeError, ValueError, RuntimeError) as error:
        reason = str(error).splitlines()[0]
        raise InputFileError(f"{path}: header and weights do not make a detector ({reason})") from error
    return header, network


def runner(network: CentreNetwork) -> CentreAnswers:
    """Runs a network on arrays; it is changed: its norms are folded into its convolutions."""
    ready = folded(network).to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def answers(pictures: UInt8[ndarray, "b h w 3"]) -> Float32[ndarray, "b y x 5"]:
        with torch.inference_mode():
            batch = torch.from_numpy(pictures).permute(0, 3, 1, 2).float().div_(255).sub_(0.5)
            return np.ascontiguousarray(ready(batch).permute(0, 2, 3, 1).numpy())

    return answers


def _single(value: torch.Tensor) -> torch.Tensor:
    return value.float() if value.is_floating_point() else value
