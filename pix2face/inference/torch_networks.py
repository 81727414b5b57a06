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
from pix2face.inference.checkpoint import METADATA_KEY, CheckpointHeader, load_weights, open_safetensors, unusable
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
    exact = {
        name: tensor
        for name, tensor in tensors.items()
        if tensor.ndim <= 1 and not name.endswith(("_norm.weight", "_norm.bias"))
    }
    write_tensors(path, METADATA_KEY, asdict(header), _in_precision(tensors, precision) | exact)


def load_checkpoint(path: Path) -> tuple[CheckpointHeader, nn.Module]:
    """Reads a checkpoint; the network computes in float32, whatever its file is in.

    Raises:
        InputFileError: The file is missing, truncated, no checkpoint, or of a newer schema.
    """
    header, arrays = load_weights(path)
    try:
        network = _without_weights(header)
        tensors = {name: torch.from_numpy(values) for name, values in arrays.items()}
        _check_shapes(network, tensors)
        weights = {name: _laid_out(tensors[name], wanted) for name, wanted in network.state_dict().items()}
        network.load_state_dict(weights, assign=True)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise unusable(path, error) from error
    return header, network.eval()


def _without_weights(header: CheckpointHeader) -> nn.Module:
    """The network that the header describes, which takes neither memory for weights nor time to draw them."""
    with torch.device("meta"):
        return build_network(
            header.architecture, header.size_px, header.widths, header.planes, header.n_landmarks, header.n_corrected
        )


def _check_shapes(network: nn.Module, tensors: Mapping[str, Tensor]) -> None:
    """Makes sure that a file has the weights of a network.

    Raises:
        ValueError: Some are missing, unknown, or of another shape.
    """
    expected = network.state_dict()
    for name in sorted(expected.keys() | tensors.keys()):
        wanted, found = (tuple(own[name].shape) if name in own else None for own in (expected, tensors))
        if wanted != found:
            raise ValueError(f"{name} should be {wanted or 'missing'} and is {found or 'missing'}")


def _laid_out(tensor: Tensor, wanted: Tensor) -> Tensor:
    """A copy in the precision and the order of memory of a tensor that has no data."""
    return torch.empty_strided(wanted.shape, wanted.stride(), dtype=wanted.dtype).copy_(tensor)


def _in_precision(tensors: Mapping[str, Tensor], precision: torch.dtype) -> dict[str, Tensor]:
    """Converts floating-point tensors to another precision; integers stay as they are."""
    return {name: tensor.to(precision) if tensor.is_floating_point() else tensor for name, tensor in tensors.items()}


def write_tensors(path: Path, key: str, header: Mapping[str, Any], tensors: Mapping[str, Tensor]) -> None:
    """Writes named tensors, of any device and layout, and one JSON header (with ``schema_version``) in one step.

    The header's ``key`` says what kind of file it is. The file's folder is made.
    """
    stored = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with written_in_one_step(path) as temporary:
        save_file(stored, temporary, metadata={key: json.dumps(header, sort_keys=True)})


def read_tensors(path: Path) -> dict[str, Tensor]:
    """Reads the tensors that ``write_tensors`` wrote.

    Raises:
        InputFileError: The file is missing, truncated or foreign.
    """
    with open_safetensors(path, "pt") as file:
        return {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)


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
