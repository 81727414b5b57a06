"""The checkpoint: weights as safetensors with one JSON header (layout: docs/reference). Loading runs no code."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, final

import msgspec
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from pix2face.errors import InputFileError, ModelMismatchError
from pix2face.files.json_text import Integer, JsonObject, Positive, parse_json, typed
from pix2face.files.opening import check_regular, is_folder, is_regular
from pix2face.files.writing import written_in_one_step
from pix2face.geometry.crops import INFERENCE_SCALE
from pix2face.inference import CHECKPOINT_NAME
from pix2face.networks import MAP_PLANES
from pix2face.networks.architectures import build_network
from pix2face.networks.paper import paper_widths

# Sides of inputs and filters of levels, as far as a network could be run on.
Side = Annotated[int, msgspec.Meta(ge=1, le=1024)]
Widths = Annotated[tuple[Side, ...], msgspec.Meta(max_length=16)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
LARGEST_FILE_BYTES, MOST_HEADER_VALUES = 1 << 33, 1_000_000
METADATA_KEY = "pix2face-checkpoint"
SCHEMA_VERSION = 5
# Residual networks of earlier schemas have planes of the finest level alone.
FIRST_WITH_COARSE_PLANES = 4


@dataclass(frozen=True)
class _FirstSchema:
    """What the first schema said of the network."""

    size_px: Side
    filters: Side


@final
@dataclass(frozen=True, kw_only=True)
class CheckpointHeader:
    """What is needed to use the weights, and where they come from."""

    model_name: str  # the morphable model whose PNCC and offset the network predicts
    model_sha256: str
    size_px: Side  # side of the network's input
    widths: Widths  # filters of each of its levels
    pncc_scale_mm: Positive  # the first three planes times this are PNCC in mm
    offset_scale_mm: Positive  # the other three planes times this are offsets in mm
    smallest_radius_mm: NotNegative  # distance from the origin to the nearest point of the mean face
    licence: str  # terms that the training data put on the weights
    configuration: str  # of the training, as JSON
    epoch: Integer  # complete ones
    samples: Integer = 0  # samples seen in training
    crop_scale: Positive = INFERENCE_SCALE  # side of the crop, in units of the longer side of the face's box
    architecture: str = "paper"  # one of ``networks.architectures.ARCHITECTURES``
    # 6 of the maps, then logits: the 7th of the mask, the 8th of the part of it that is seen; the 9th is the logarithm
    # of the scale of PNCC's errors.
    planes: int = MAP_PLANES
    # Number of the model's own landmarks that the network predicts beside the planes.
    n_landmarks: Annotated[int, msgspec.Meta(ge=0, le=1024)] = 0
    # Number of coefficients of the fits that the network corrects; 0 if it corrects none.
    n_corrected: Annotated[int, msgspec.Meta(ge=0, le=1024)] = 0
    # Vertices of the schemes for which they were chosen on fits to this network's own maps.
    landmarks: Mapping[str, tuple[Integer, ...]] = field(default_factory=dict)
    schema_version: int = SCHEMA_VERSION

    @property
    def filters(self) -> int:
        """Filters of the first level."""
        return self.widths[0]

    @classmethod
    def from_json(cls, fields: Mapping[str, Any]) -> "CheckpointHeader":
        """Restores a header from the JSON form of ``asdict``, of this schema or an earlier one.

        Raises:
            ValueError: A field is missing, unknown, of another type, or has a value that no network has.
        """
        known = dict(fields)
        if known.get("schema_version") == 1:  # the paper's network was the only one, told by its first level
            old: _FirstSchema = typed(known, _FirstSchema)
            known |= {"widths": paper_widths(old.size_px, old.filters), "schema_version": 2}
            del known["filters"]
        if known.get("schema_version") in {2, 3, 4}:  # 2: without landmarks; 4: without corrections
            known["schema_version"] = SCHEMA_VERSION
        unknown = known.keys() - cls.__dataclass_fields__.keys()
        if unknown:
            raise ValueError(f"the unknown field {min(unknown)!r}")
        header: CheckpointHeader = typed(known, cls)
        parse_json(header.configuration, JsonObject)
        return header

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


def load_header(path: Path) -> CheckpointHeader:
    """Reads what a checkpoint says of itself, without its weights.

    Raises:
        InputFileError: The file is missing, truncated, no checkpoint, or of a newer schema.
    """
    return _header_of(path, read_header(path, METADATA_KEY, SCHEMA_VERSION))


def load_checkpoint(path: Path) -> tuple[CheckpointHeader, nn.Module]:
    """Reads a checkpoint; the network computes in float32, whatever its file is in.

    Raises:
        InputFileError: The file is missing, truncated, no checkpoint, or of a newer schema.
    """
    fields = read_header(path, METADATA_KEY, SCHEMA_VERSION)
    header, tensors = _header_of(path, fields), read_tensors(path)
    try:
        network = _without_weights(header)
        if fields["schema_version"] < FIRST_WITH_COARSE_PLANES:
            tensors |= _zeros(network, "coarse_planes.")
        _check_shapes(network, tensors)
        weights = {name: _laid_out(tensors[name], wanted) for name, wanted in network.state_dict().items()}
        network.load_state_dict(weights, assign=True)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise _unusable(path, error) from error
    return header, network.eval()


def _header_of(path: Path, fields: Mapping[str, Any]) -> CheckpointHeader:
    try:
        return CheckpointHeader.from_json(fields)
    except ValueError as error:
        raise _unusable(path, error) from error


def _without_weights(header: CheckpointHeader) -> nn.Module:
    """The network that the header describes, which takes neither memory for weights nor time to draw them."""
    with torch.device("meta"):
        return build_network(
            header.architecture, header.size_px, header.widths, header.planes, header.n_landmarks, header.n_corrected
        )


def _zeros(network: nn.Module, prefix: str) -> dict[str, Tensor]:
    """Zeros for the weights whose names begin so."""
    return {name: torch.zeros(own.shape) for name, own in network.state_dict().items() if name.startswith(prefix)}


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
        header: dict[str, Any] = parse_json(metadata[key], JsonObject, MOST_HEADER_VALUES)
        version = typed(header.get("schema_version"), Integer)
    except (KeyError, ValueError) as error:
        found = f"{', '.join(sorted(metadata)) or 'no metadata'} ({error})"
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
    if is_folder(path):
        raise InputFileError(f"{path}: expected a checkpoint, found a folder; training writes {path / CHECKPOINT_NAME}")
    if not is_regular(path):
        raise InputFileError(f"{path}: no such file; `train --shards DIR` writes checkpoints, --checkpoint names one")
    check_regular(path, "a checkpoint", LARGEST_FILE_BYTES)
    try:
        with safe_open(path, framework="pt") as file:
            yield file
    except (SafetensorError, OSError, MemoryError) as error:  # MemoryError: of a file that cannot be mapped
        raise InputFileError(
            f"{path}: expected a complete safetensors file, found one that cannot be read ({error}); "
            "fetch or write it again"
        ) from error
