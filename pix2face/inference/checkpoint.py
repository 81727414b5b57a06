"""The checkpoint: weights as safetensors with one JSON header (layout: docs/reference). Loading runs no code."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, final

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from pix2face.errors import InputFileError, ModelMismatchError
from pix2face.files.writing import written_in_one_step
from pix2face.geometry.crops import INFERENCE_SCALE
from pix2face.inference import CHECKPOINT_NAME
from pix2face.networks.architectures import build_network
from pix2face.networks.paper import MAP_PLANES, paper_widths

METADATA_KEY = "pix2face-checkpoint"
SCHEMA_VERSION = 2


@final
@dataclass(frozen=True, kw_only=True)
class CheckpointHeader:
    """What is needed to use the weights, and where they come from."""

    model_name: str  # the morphable model whose PNCC and offset the network predicts
    model_sha256: str
    size_px: int  # side of the network's input
    widths: tuple[int, ...]  # filters of each of its levels
    pncc_scale_mm: float  # the first three planes times this are PNCC in mm
    offset_scale_mm: float  # the other three planes times this are offsets in mm
    smallest_radius_mm: float  # distance from the origin to the nearest point of the mean face
    licence: str  # terms that the training data put on the weights
    configuration: str  # of the training, as JSON
    epoch: int  # complete ones
    samples: int = 0  # samples seen in training
    crop_scale: float = INFERENCE_SCALE  # side of the crop, in units of the longer side of the face's box
    architecture: str = "paper"  # one of ``networks.architectures.ARCHITECTURES``
    planes: int = MAP_PLANES  # 6 of the maps, then logits: the 7th of the mask, the 8th of the part of it that is seen
    # Vertices of the schemes for which they were chosen on fits to this network's own maps.
    landmarks: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    schema_version: int = SCHEMA_VERSION

    @property
    def filters(self) -> int:
        """Filters of the first level."""
        return self.widths[0]

    @classmethod
    def from_json(cls, fields: Mapping[str, Any]) -> "CheckpointHeader":
        """Restores a header from the JSON form of ``asdict``, of this schema or an earlier one.

        Raises:
            TypeError: A field is missing, unknown, or of another type.
            ValueError: One has a value that no network has.
        """
        known = dict(fields)
        if known["schema_version"] == 1:  # the paper's network was the only one, told by its first level
            known |= {"widths": paper_widths(known["size_px"], known.pop("filters")), "schema_version": SCHEMA_VERSION}
        known["widths"] = tuple(int(width) for width in known.get("widths", ()))
        chosen = dict(known.get("landmarks", {}))
        known["landmarks"] = {str(scheme): tuple(map(int, vertices)) for scheme, vertices in chosen.items()}
        return cls(**known)

    def check_model(self, name: str, sha256: str) -> None:
        """Checks that a model is the one whose maps the network predicts.

        Raises:
            ModelMismatchError: It is another one.
        """
        if sha256 != self.model_sha256:
            raise ModelMismatchError(
                f"the checkpoint was trained for the morphable model {self.model_name!r} "
                f"({self.model_sha256[:12]}), the one in use is {name!r} ({sha256[:12]}); "
                "choose the former with --model, or another checkpoint with --checkpoint"
            )


def save_checkpoint(
    path: Path, header: CheckpointHeader, network: nn.Module, precision: torch.dtype = torch.float32
) -> None:
    """Writes a checkpoint; a file of that name is replaced at once or not at all.

    Weights in float16 halve the file, and are computed with in float32 all the same. Norms and biases stay float32:
    they are few, and variances of norms overflow float16.
    """
    tensors = network.state_dict()
    vectors = {name: tensor for name, tensor in tensors.items() if tensor.ndim <= 1}
    write_tensors(path, METADATA_KEY, asdict(header), _in_precision(tensors, precision) | vectors)


def load_header(path: Path) -> CheckpointHeader:
    """Reads what a checkpoint says of itself, without its weights.

    Raises:
        InputFileError: The file is missing, truncated, no checkpoint, or of a newer schema.
    """
    fields = read_header(path, METADATA_KEY, SCHEMA_VERSION)
    try:
        return CheckpointHeader.from_json(fields)
    except (KeyError, TypeError, ValueError) as error:
        raise _unusable(path, error) from error


def load_checkpoint(path: Path) -> tuple[CheckpointHeader, nn.Module]:
    """Reads a checkpoint; the network computes in float32, whatever its file is in.

    Raises:
        InputFileError: The file is missing, truncated, no checkpoint, or of a newer schema.
    """
    header, tensors = load_header(path), read_tensors(path)
    try:
        network = build_network(header.architecture, header.size_px, header.widths, header.planes)
        network.load_state_dict(_in_precision(tensors, torch.float32))
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise _unusable(path, error) from error
    return header, network.eval()


def _unusable(path: Path, error: Exception) -> InputFileError:
    reason = str(error).splitlines()[0]
    return InputFileError(f"{path}: header and weights do not make a network ({reason}); train or fetch it again")


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


def read_header(path: Path, key: str, newest_schema: int) -> dict[str, Any]:
    """Reads the header that ``write_tensors`` wrote, and no tensor.

    Raises:
        InputFileError: The file is missing, truncated, of another kind, or of a newer schema.
    """
    with _open(path) as file:
        metadata = file.metadata() or {}
    try:
        header = json.loads(metadata[key])
        version = int(header["schema_version"])
    except (KeyError, TypeError, ValueError) as error:
        found = ", ".join(sorted(metadata)) or "no metadata"
        raise InputFileError(f"{path}: expected {key} in the safetensors header, found {found}") from error
    if version > newest_schema:
        raise InputFileError(
            f"{path}: {key} schema {version} is newer than {newest_schema}, which this version reads; upgrade pix2face"
        )
    return header


def read_tensors(path: Path) -> dict[str, Tensor]:
    """Reads the tensors that ``write_tensors`` wrote.

    Raises:
        InputFileError: The file is missing, truncated or foreign.
    """
    with _open(path) as file:
        return {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    """Opens a safetensors file, which checks that it is whole."""
    if path.is_dir():
        raise InputFileError(f"{path}: expected a checkpoint, found a folder; training writes {path / CHECKPOINT_NAME}")
    if not path.is_file():
        raise InputFileError(f"{path}: no such file; `train --shards DIR` writes checkpoints, --checkpoint names one")
    try:
        with safe_open(path, framework="pt") as file:
            yield file
    except (SafetensorError, OSError) as error:
        raise InputFileError(
            f"{path}: expected a complete safetensors file, found one that cannot be read ({error}); "
            "fetch or write it again"
        ) from error
