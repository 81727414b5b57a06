"""The checkpoint: weights as safetensors with one JSON header (layout: docs/reference). Loading runs no code."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, final

import msgspec
import numpy as np
from numpy import ndarray
from safetensors import SafetensorError, safe_open

from pix2face.errors import InputFileError, ModelMismatchError
from pix2face.files.json_text import Integer, JsonObject, Positive, parse_json, typed
from pix2face.files.opening import check_regular, is_folder, is_regular
from pix2face.geometry.crops import INFERENCE_SCALE
from pix2face.inference import CHECKPOINT_NAME
from pix2face.networks import MAP_PLANES
from pix2face.networks.dimensions import LARGEST_SIDE_PX, MOST_FILTERS, check_network, paper_widths

Side = Annotated[int, msgspec.Meta(ge=1, le=LARGEST_SIDE_PX)]
Widths = Annotated[tuple[Annotated[int, msgspec.Meta(ge=1, le=MOST_FILTERS)], ...], msgspec.Meta(max_length=16)]
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
    architecture: str = "paper"  # one of ``networks.dimensions.ARCHITECTURES``
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


def load_header(path: Path) -> CheckpointHeader:
    """Reads what a checkpoint says of itself, without its weights.

    Raises:
        InputFileError: The file is missing, truncated, no checkpoint, or of a newer schema.
    """
    return _header_of(path, read_header(path, METADATA_KEY, SCHEMA_VERSION))


def load_weights(path: Path) -> tuple[CheckpointHeader, dict[str, ndarray]]:
    """Reads a checkpoint without torch: its header and its arrays, by the names that they have in torch.

    Raises:
        InputFileError: The file is missing, truncated, no checkpoint, or of a newer schema.
    """
    fields = read_header(path, METADATA_KEY, SCHEMA_VERSION)
    header, arrays = _header_of(path, fields), read_arrays(path)
    numbers = header.planes, header.n_landmarks, header.n_corrected
    try:
        check_network(header.architecture, header.size_px, header.widths, *numbers)
    except ValueError as error:
        raise unusable(path, error) from error
    if fields["schema_version"] < FIRST_WITH_COARSE_PLANES and header.architecture == "residual":
        for place, width in enumerate(header.widths[-2:0:-1]):
            arrays[f"coarse_planes.{place}.weight"] = np.zeros((header.planes, width, 1, 1), np.float32)
            arrays[f"coarse_planes.{place}.bias"] = np.zeros(header.planes, np.float32)
    return header, arrays


def _header_of(path: Path, fields: Mapping[str, Any]) -> CheckpointHeader:
    try:
        return CheckpointHeader.from_json(fields)
    except ValueError as error:
        raise unusable(path, error) from error


def unusable(path: Path, error: Exception) -> InputFileError:
    """The error of a file whose header and weights contradict each other."""
    reason = str(error).splitlines()[0]
    return InputFileError(f"{path}: header and weights do not make a network ({reason}); train or fetch it again")


def read_header(path: Path, key: str, newest_schema: int) -> dict[str, Any]:
    """Reads the header that ``write_tensors`` wrote, and no tensor.

    Raises:
        InputFileError: The file is missing, truncated, of another kind, or of a newer schema.
    """
    with open_safetensors(path, "numpy") as file:
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


def read_arrays(path: Path) -> dict[str, ndarray]:
    """Reads the arrays of a safetensors file.

    Raises:
        InputFileError: The file is missing, truncated or foreign, or has arrays of a type that NumPy does not know.
    """
    with open_safetensors(path, "numpy") as file:
        try:
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
            for name, own in arrays.items():
                if own.dtype.kind not in "fiu":
                    raise TypeError(f"{name} is {own.dtype}")
        except (TypeError, AttributeError, ValueError) as error:  # ValueError: of more dimensions than NumPy has
            raise InputFileError(f"{path}: expected arrays in float16 or float32, found others ({error})") from error
    return arrays


@contextmanager
def open_safetensors(path: Path, framework: str) -> Iterator[Any]:
    """Opens a safetensors file, which checks that it is whole.

    Raises:
        InputFileError: The file is missing, truncated or foreign.
    """
    if is_folder(path):
        raise InputFileError(f"{path}: expected a checkpoint, found a folder; training writes {path / CHECKPOINT_NAME}")
    if not is_regular(path):
        raise InputFileError(f"{path}: no such file; `train --shards DIR` writes checkpoints, --checkpoint names one")
    check_regular(path, "a checkpoint", LARGEST_FILE_BYTES)
    try:
        with safe_open(path, framework=framework) as file:
            yield file
    except (SafetensorError, OSError, MemoryError) as error:  # MemoryError: of a file that cannot be mapped
        raise InputFileError(
            f"{path}: expected a complete safetensors file, found one that cannot be read ({error}); "
            "fetch or write it again"
        ) from error
