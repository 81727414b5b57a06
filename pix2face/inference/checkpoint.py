"""The checkpoint: weights as safetensors with one JSON header (layout: docs/reference). Loading runs no code."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, final

import msgspec
import numpy as np
from numpy import ndarray

from pix2face.errors import ModelMismatchError
from pix2face.files.json_text import Integer, JsonObject, Positive, parse_json, typed
from pix2face.geometry.crops import INFERENCE_SCALE
from pix2face.inference.weight_files import header_fits_weights, read_arrays, read_header
from pix2face.networks import MAP_PLANES
from pix2face.networks.dimensions import LARGEST_SIDE_PX, MOST_FILTERS, check_network, paper_widths

Side = Annotated[int, msgspec.Meta(ge=1, le=LARGEST_SIDE_PX)]
Widths = Annotated[tuple[Annotated[int, msgspec.Meta(ge=1, le=MOST_FILTERS)], ...], msgspec.Meta(max_length=16)]
Offset = tuple[float, float, float]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
METADATA_KEY = "pix2face-checkpoint"
SCHEMA_VERSION = 6
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
    # How far these landmarks lie from their vertices, mm in the model frame; schemes that are absent lie at them.
    landmark_offsets_mm: Mapping[str, tuple[Offset, ...]] = field(default_factory=dict)
    schema_version: int = SCHEMA_VERSION

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
        # 2: without landmarks; 4: without corrections; 5: without offsets of landmarks
        if known.get("schema_version") in {2, 3, 4, 5}:
            known["schema_version"] = SCHEMA_VERSION
        unknown = known.keys() - cls.__dataclass_fields__.keys()
        if unknown:
            raise ValueError(f"the unknown field {min(unknown)!r}")
        header: CheckpointHeader = typed(known, cls)
        parse_json(header.configuration, JsonObject)
        numbers = header.planes, header.n_landmarks, header.n_corrected
        check_network(header.architecture, header.size_px, header.widths, *numbers)
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
    if fields["schema_version"] < FIRST_WITH_COARSE_PLANES and header.architecture == "residual":
        for place, width in enumerate(header.widths[-2:0:-1]):
            arrays[f"coarse_planes.{place}.weight"] = np.zeros((header.planes, width, 1, 1), np.float32)
            arrays[f"coarse_planes.{place}.bias"] = np.zeros(header.planes, np.float32)
    return header, arrays


def _header_of(path: Path, fields: Mapping[str, Any]) -> CheckpointHeader:
    with header_fits_weights(path, "network"):
        return CheckpointHeader.from_json(fields)
