"""The state at the end of an epoch, from which a training goes on exactly as if it had not been interrupted.

It is a safetensors file like the checkpoint, so reading it runs no code either. No state of a random generator is in
it: order and jitter follow from the seed and the number of a draw, and the network itself draws nothing.
"""

import json
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from pix2face.checkpoint import read_header, read_tensors, write_tensors
from pix2face.errors import InputFileError, UsageError

METADATA_KEY = "pix2face-resume"
SCHEMA_VERSION = 1
_ADAM_STATE = ("step", "exp_avg", "exp_avg_sq")


def save_resume_state(
    path: Path, network: nn.Module, optimiser: torch.optim.Adam, configuration: str, epoch: int
) -> None:
    """Writes weights and the optimiser's state; the old file is replaced at once or not at all.

    Args:
        path: Where to.
        network: Its parameters are all that it has.
        optimiser: Over these parameters, after at least one step.
        configuration: Of the training, as JSON.
        epoch: Epochs done.
    """
    tensors: dict[str, Tensor] = {}
    for name, parameter in network.named_parameters():
        tensors[f"weight/{name}"] = parameter
        for key in _ADAM_STATE:
            tensors[f"{key}/{name}"] = optimiser.state[parameter][key]
    header = {"schema_version": SCHEMA_VERSION, "configuration": configuration, "epoch": epoch}
    write_tensors(path, METADATA_KEY, header, tensors)


def epochs_done(path: Path, configuration: str) -> int:
    """How far an interrupted training came.

    Args:
        path: What ``save_resume_state`` wrote, or nothing: then 0.
        configuration: Of the training that is to go on, as JSON.

    Raises:
        InputFileError: The file is truncated, foreign, or of a newer schema.
        UsageError: It belongs to a training with another configuration.
    """
    if not path.exists():
        return 0
    header = read_header(path, METADATA_KEY, SCHEMA_VERSION)
    _check_same_configuration(path, json.loads(header["configuration"]), json.loads(configuration))
    return int(header["epoch"])


def load_resume_state(path: Path, network: nn.Module, optimiser: torch.optim.Adam) -> None:
    """Puts weights and the optimiser's state back.

    Args:
        path: What ``save_resume_state`` wrote.
        network: Is overwritten.
        optimiser: Over its parameters; is overwritten.

    Raises:
        InputFileError: The file is truncated or foreign.
    """
    tensors = read_tensors(path)
    try:
        for name, parameter in network.named_parameters():
            parameter.data.copy_(tensors[f"weight/{name}"])
            optimiser.state[parameter] = {
                # Moments keep the memory layout of their parameter: Adam's fused kernel walks both side by side.
                key: _in_layout_of(parameter, tensors[f"{key}/{name}"])
                for key in _ADAM_STATE
            }
    except (KeyError, RuntimeError) as error:
        raise InputFileError(
            f"{path}: expected the state of this training, found another content ({error}); --restart starts anew"
        ) from error


def _in_layout_of(parameter: Tensor, value: Tensor) -> Tensor:
    return value if value.ndim == 0 else torch.empty_like(parameter).copy_(value)


def _check_same_configuration(path: Path, stored: dict[str, Any], present: dict[str, Any]) -> None:
    differing = [
        f"{key} {stored.get(key)!r} -> {present.get(key)!r}"
        for key in sorted(stored.keys() | present.keys())
        if stored.get(key) != present.get(key)
    ]
    if differing:
        raise UsageError(
            f"{path.parent} holds a training with another configuration ({'; '.join(differing)}); "
            "give the same options to go on with it, --restart to replace it, or another --out"
        )
