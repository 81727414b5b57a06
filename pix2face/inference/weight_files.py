"""Files of weights: arrays as safetensors, with one JSON header in the metadata. They are read without torch."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, final

import numpy as np
from jaxtyping import Float32, Shaped
from numpy import ndarray
from safetensors import SafetensorError, safe_open

from pix2face.errors import InputFileError
from pix2face.files.json_text import Integer, JsonObject, parse_json, typed
from pix2face.files.opening import check_regular, is_folder, is_regular
from pix2face.inference import CHECKPOINT_NAME

LARGEST_FILE_BYTES, MOST_HEADER_VALUES = 1 << 33, 1_000_000
NORM_EPSILON = 1e-5  # of torch's batch norms


def read_header(path: Path, key: str, newest_schema: int) -> dict[str, Any]:
    """Reads the header of a file, and no array.

    Raises:
        InputFileError: The file is missing, truncated, of another kind, or of a newer schema.
    """
    with _open_safetensors(path) as file:
        metadata = file.metadata() or {}
    return header_in(metadata, path, key, newest_schema)


def header_in(metadata: Mapping[str, str], path: Path, key: str, newest_schema: int) -> dict[str, Any]:
    """The header in the metadata of a file, which has a ``schema_version``. The key says what kind of file it is.

    Raises:
        InputFileError: The file is of another kind, or of a newer schema.
    """
    try:
        header: dict[str, Any] = parse_json(metadata[key], JsonObject, MOST_HEADER_VALUES)
        version = typed(header.get("schema_version"), Integer)
    except (KeyError, ValueError) as error:
        found = f"{', '.join(sorted(metadata)) or 'none'} ({error})"
        raise InputFileError(f"{path}: expected {key} in the metadata, found {found}") from error
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
    with _open_safetensors(path) as file:
        try:
            arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (not a mapping)
            for name, own in arrays.items():
                if own.dtype.kind not in "fiu":
                    raise TypeError(f"{name} is {own.dtype}")
        except (TypeError, AttributeError, ValueError) as error:  # ValueError: of more dimensions than NumPy has
            raise InputFileError(f"{path}: expected arrays in float16 or float32, found others ({error})") from error
    return arrays


@contextmanager
def header_fits_weights(path: Path, what: str) -> Iterator[None]:
    """Says in one line that the header and the weights of a file contradict each other.

    Raises:
        InputFileError: They do: the block has raised another error.
    """
    try:
        yield
    except (ValueError, RuntimeError) as error:  # RuntimeError: of torch
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputFileError(
            f"{path}: header and weights do not make a {what} ({reason}); train or fetch it again"
        ) from error


@final
class Weights:
    """The arrays of a checkpoint, each of which is taken once.

    Args:
        arrays: By the names that they have in torch.
    """

    def __init__(self, arrays: Mapping[str, ndarray]) -> None:
        self._left = dict(arrays)

    def take(self, name: str, *shape: int, dtype: type[np.number] = np.float32) -> Shaped[ndarray, "..."]:
        """Returns an array.

        Raises:
            ValueError: It is missing or of another shape.
        """
        found = self._left.pop(name, None)
        if found is None or found.shape != shape:
            raise ValueError(f"{name} should be {shape} and is {'missing' if found is None else found.shape}")
        # Where a file is damaged, maps are not finite, and that is said.
        with np.errstate(over="ignore", invalid="ignore"):
            return found.astype(dtype)

    def take_norm(self, name: str, width: int) -> tuple[Float32[ndarray, " c"], Float32[ndarray, " c"]]:
        """Mean, and deviation with the epsilon that torch adds, of a batch norm."""
        self._left.pop(f"{name}.num_batches_tracked", None)
        mean, variance = (self.take(f"{name}.{part}", width) for part in ("running_mean", "running_var"))
        with np.errstate(invalid="ignore"):
            return mean, np.sqrt(variance + np.float32(NORM_EPSILON))

    def check_empty(self) -> None:
        """Checks that everything was taken.

        Raises:
            ValueError: Something is left.
        """
        for name in sorted(self._left):
            raise ValueError(f"{name} should be missing and is {self._left[name].shape}")


@contextmanager
def _open_safetensors(path: Path) -> Iterator[Any]:
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
        with safe_open(path, framework="numpy") as file:
            yield file
    except (SafetensorError, OSError, MemoryError) as error:  # MemoryError: of a file that cannot be mapped
        raise InputFileError(
            f"{path}: expected a complete safetensors file, found one that cannot be read ({error}); "
            "fetch or write it again"
        ) from error
