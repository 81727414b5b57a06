"""Networks in torch, for training and for GPUs: from and to checkpoints, and run on arrays."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, final

import numpy as np
import torch
from jaxtyping import Float32
from numpy import ndarray
from safetensors.torch import save_file
from torch import Tensor, nn

from pix2face.errors import UsageError
from pix2face.files.writing import written_in_one_step
from pix2face.inference.answers import Answers
from pix2face.inference.checkpoint import METADATA_KEY, CheckpointHeader, load_weights
from pix2face.inference.weight_files import Weights, header_fits_weights
from pix2face.networks.architectures import build_network
from pix2face.networks.residual import ResidualUNet


def save_checkpoint(
    path: Path, header: CheckpointHeader, network: nn.Module, precision: torch.dtype = torch.float32
) -> None:
    """Writes a checkpoint; a file of that name is replaced at once or not at all.

    Weights in float16 halve the file, and are converted to float32 when it is read. Statistics of norms stay float32,
    since variances overflow float16, and so do the few biases of what is answered.
    """
    tensors = network.state_dict()
    for name, tensor in tensors.items():
        if tensor.is_floating_point() and (tensor.ndim > 1 or name.endswith(("_norm.weight", "_norm.bias"))):
            tensors[name] = tensor.to(precision)
    write_tensors(path, METADATA_KEY, asdict(header), tensors)


def load_checkpoint(path: Path) -> tuple[CheckpointHeader, nn.Module]:
    """Reads a checkpoint; the network computes in float32, whatever its file is in.

    Raises:
        InputFileError: The file is missing, truncated, no checkpoint, or of a newer schema.
    """
    header, arrays = load_weights(path)
    numbers = header.planes, header.n_landmarks, header.n_corrected
    with header_fits_weights(path, "network"):
        with torch.device("meta"):  # takes neither memory for weights nor time to draw them
            network = build_network(header.architecture, header.size_px, header.widths, *numbers)
        fill_network(network, Weights(arrays))
    return header, network.eval()


def fill_network(network: nn.Module, weights: Weights) -> None:
    """Gives a network the weights of a file.

    Raises:
        ValueError: Some are missing, unknown, or of another shape.
    """
    tensors = {name: tensor_like(wanted, weights, name) for name, wanted in network.state_dict().items()}
    weights.check_empty()
    network.load_state_dict(tensors, assign=True)


def tensor_like(wanted: Tensor, weights: Weights, name: str) -> Tensor:
    """A tensor of a file, in the shape, the precision and the order of memory of another, which needs no data.

    Raises:
        ValueError: It is missing, or of another shape.
    """
    values = weights.take(name, *wanted.shape, dtype=np.float32 if wanted.is_floating_point() else np.int64)
    return torch.empty_like(wanted, device="cpu").copy_(torch.from_numpy(values))


def write_tensors(path: Path, key: str, header: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> None:
    """Writes named tensors, of any device and layout, and one JSON header (with ``schema_version``) in one step.

    The header's ``key`` says what kind of file it is. The file's folder is made.
    """
    stored = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with written_in_one_step(path) as temporary:
        save_file(stored, temporary, metadata={key: json.dumps(header, sort_keys=True)})


@final
class TorchNetwork:
    """A ``pix2face.inference.answers.Network`` that torch runs. The network is moved to the device.

    Args:
        network: It is put into evaluation mode.
        device: Where it is run.
    """

    def __init__(self, network: nn.Module, device: torch.device | str = "cpu") -> None:
        self._network, self._device = network.eval().to(device), device

    def answers(self, pictures: Float32[ndarray, "b s s 3"]) -> Answers:
        """Everything that it answers."""
        network = self._network
        with torch.inference_mode():
            batch = torch.from_numpy(pictures).permute(0, 3, 1, 2).to(self._device)
            landmarks = seen = None
            if isinstance(network, ResidualUNet):
                planes, landmarks, levels = network.read(batch)
                if network.correction is not None:
                    seen = network.correction.seen(levels)
            else:
                planes = network(batch)
            found = (None if own is None else own.float().cpu().numpy() for own in (landmarks, seen))
            return Answers(np.ascontiguousarray(planes.float().permute(0, 2, 3, 1).cpu().numpy()), *found)

    def landmarks(self, pictures: Float32[ndarray, "b s s 3"]) -> Float32[ndarray, "b n 3"]:
        """The landmarks alone."""
        landmarks = self.answers(pictures).landmarks
        assert landmarks is not None
        return landmarks


def torch_device(name: str | None) -> torch.device:
    """The device with a name; None selects a GPU if there is one.

    Raises:
        UsageError: There is no such device.
    """
    try:
        device = torch.device(name or ("cuda" if torch.cuda.is_available() else "cpu"))
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        reason = str(error).splitlines()[0]
        raise UsageError(f"expected a torch device that is there, such as cpu, found {name!r} ({reason})") from error
    return device
