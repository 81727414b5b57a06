"""The state of a training after any step, from which it goes on exactly as if it had not been interrupted.

It is a safetensors file like the checkpoint, so reading it runs no code either. Order and jitter follow from the seed
and the number of a draw, the learning rate from the number of a step, and the networks draw nothing: beside weights,
moments, running means and the number of the next step there is no state, and no random generator's.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import torch
from torch import Tensor, nn

from pix2face.errors import InputFileError, UsageError
from pix2face.files.json_text import Count, JsonObject, parse_json, typed
from pix2face.inference.torch_networks import tensor_like, write_tensors
from pix2face.inference.weight_files import Weights, read_arrays, read_header
from training.loop.learner import Learner

METADATA_KEY = "pix2face-resume"
SCHEMA_VERSION = 2
# What a configuration without these numbers meant by it.
_ADDED_LATER = {"norm_batches": 0}
_LENGTH = frozenset(("epochs", "epoch_size"))
_ADAM_STATE = ("step", "exp_avg", "exp_avg_sq")


@final
@dataclass(frozen=True)
class _Header:
    """What the file says beside its tensors."""

    configuration: str  # of the training, as JSON
    step: Count
    best: float | None  # lowest validation error, if there was one


def save_state(path: Path, learner: Learner, configuration: str, best: float = math.inf) -> None:
    """Writes all that the next step depends on; the old file is replaced at once or not at all.

    Args:
        path: Where to.
        learner: After at least one step.
        configuration: Of the training, as JSON.
        best: Lowest validation error so far.
    """
    tensors = dict(_own_tensors(learner))
    for name, parameter in _learning(learner):
        for key in _ADAM_STATE:
            tensors[f"{key}/{name}"] = learner.optimiser.state[parameter][key]
    header = {
        "schema_version": SCHEMA_VERSION,
        "configuration": configuration,
        "step": learner.steps_done,
        "best": best if math.isfinite(best) else None,
    }
    write_tensors(path, METADATA_KEY, header, tensors)


def steps_done(path: Path, configuration: str) -> int:
    """How far an interrupted training came.

    Args:
        path: What ``save_state`` wrote, or nothing: then 0.
        configuration: Of the training that is to go on, as JSON.

    Raises:
        InputFileError: The file is truncated, foreign, or of another schema.
        UsageError: It belongs to a training with another configuration.
    """
    if not path.exists():
        return 0
    header = _read_header(path)
    try:
        stored = parse_json(header.configuration, JsonObject)
    except ValueError as error:
        raise _foreign(path, error) from error
    _check_same_configuration(path, stored, parse_json(configuration, JsonObject))
    return header.step


def load_state(path: Path, learner: Learner) -> float:
    """Puts everything back.

    Args:
        path: What ``save_state`` wrote.
        learner: Of the same recipe; is overwritten.

    Returns:
        The lowest validation error so far; infinity where there was none.

    Raises:
        InputFileError: The file is truncated or foreign.
    """
    header, weights = _read_header(path), Weights(read_arrays(path))
    try:
        with torch.no_grad():
            for name, own in _own_tensors(learner):
                own.copy_(tensor_like(own, weights, name))
        for name, parameter in _learning(learner):
            # Moments keep the memory layout of their parameter: Adam's fused kernel walks both side by side.
            like = {"step": torch.tensor(0.0), "exp_avg": parameter, "exp_avg_sq": parameter}
            learner.optimiser.state[parameter] = {
                key: tensor_like(own, weights, f"{key}/{name}").to(parameter.device) for key, own in like.items()
            }
        learner.steps_done = header.step
    except ValueError as error:
        raise _foreign(path, error) from error
    return math.inf if header.best is None else header.best


def _read_header(path: Path) -> _Header:
    fields = read_header(path, METADATA_KEY, SCHEMA_VERSION)
    if fields["schema_version"] < SCHEMA_VERSION:
        raise InputFileError(
            f"{path}: expected schema {SCHEMA_VERSION}, found {fields['schema_version']}, of an earlier version; "
            "--restart starts anew"
        )
    try:
        header: _Header = typed(fields, _Header)
    except ValueError as error:
        raise _foreign(path, error) from error
    return header


def _foreign(path: Path, error: Exception) -> InputFileError:
    return InputFileError(
        f"{path}: expected the state of this training, found another content ({error}); --restart starts anew"
    )


def _own_tensors(learner: Learner) -> Iterator[tuple[str, Tensor]]:
    """Weights and statistics of the network, and their running means; not copied."""
    for name, tensor in learner.network.state_dict().items():
        yield f"weight/{name}", tensor
    if learner.mean:
        for name, tensor in learner.mean.network.state_dict().items():
            yield f"mean/{name}", tensor


def _learning(learner: Learner) -> list[tuple[str, nn.Parameter]]:
    return [named for named in learner.network.named_parameters() if named[1].requires_grad]


def _check_same_configuration(path: Path, stored: dict[str, Any], present: dict[str, Any]) -> None:
    stored, present = _ADDED_LATER | stored, _ADDED_LATER | present
    differing = [key for key in sorted(stored.keys() | present.keys()) if stored.get(key) != present.get(key)]
    if not differing:
        return
    changes = "; ".join(f"{key} {stored.get(key)!r} -> {present.get(key)!r}" for key in differing)
    advice = "give the same options to go on with it, --restart to replace it, or another --out"
    if _LENGTH.issuperset(differing):
        advice += (
            ". The learning rate falls over the whole training, so one of another length is another training from its "
            "first step; to go on from the weights of this one, give its checkpoint as --init, and another --out"
        )
    raise UsageError(f"{path.parent} holds a training with another configuration ({changes}); {advice}")
