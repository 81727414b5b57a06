"""Landmarks of a model chosen by the user: a JSON file that says where each of them is (docs/reference)."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, final

import numpy as np

from pix2face.errors import InputFileError, ModelMismatchError, UsageError
from pix2face.files.json_text import Integer, read_json_file
from pix2face.files.writing import write_file
from pix2face.geometry.landmarks import IBUG68, IBUG68_2D, SCHEMES
from pix2face.inference.checkpoint import CheckpointHeader, Offset
from pix2face.landmark_choice.landmark_offsets import LandmarkSelection
from pix2face.models.morphable_model import MorphableModel, open_model

FORMAT = "pix2face-landmarks"
SCHEMA_VERSION = 2
LARGEST_FILE_BYTES = 1 << 20
OFFSET_DECIMALS = 2


@final
@dataclass(frozen=True)
class ModelName:
    """The model of the vertices: those of one mesh mean nothing on another."""

    name: str
    sha256: str


@final
@dataclass(frozen=True)
class LandmarkChoice:
    """What is read of a file: where the landmarks of a scheme are on a model.

    Attributes:
        format: Tells the file from other JSON.
        schema_version: Of the file.
        scheme: One of ``landmarks.SCHEMES``.
        vertices: One for each landmark.
        model: The model.
        offsets_mm: How far each landmark lies from its vertex, mm in the model frame; empty if all lie at them, as in
            files of schema 1.
    """

    format: Literal["pix2face-landmarks"]
    schema_version: Integer
    scheme: str
    vertices: tuple[Integer, ...]
    model: ModelName
    offsets_mm: tuple[Offset, ...] = ()


def save_landmarks(
    path: Path, model: MorphableModel, scheme: str, selection: LandmarkSelection, origin: dict[str, Any]
) -> None:
    """Writes chosen landmarks with their errors and, for the reader, the data that they were chosen on (``origin``)."""
    content = {
        "format": FORMAT,
        "schema_version": SCHEMA_VERSION,
        "scheme": scheme,
        "model": {"name": model.name, "sha256": model.sha256},
        "vertices": selection.vertices.tolist(),
        "offsets_mm": selection.offsets_mm.round(OFFSET_DECIMALS).tolist(),
        "error": selection.error.round(6).tolist(),
        "held_out_error": selection.held_out_error.round(6).tolist(),
        "n_frames": selection.n_frames.tolist(),
        "origin": origin,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, json.dumps(content, indent=1) + "\n")


def load_landmarks(path: Path) -> LandmarkChoice:
    """Reads chosen landmarks.

    Raises:
        InputFileError: The file is missing, of another format or a newer schema, or has another number of landmarks.
    """
    expected = "landmarks as `pix2face landmarks select` writes them"
    choice: LandmarkChoice = read_json_file(path, LandmarkChoice, expected, LARGEST_FILE_BYTES)
    if choice.schema_version > SCHEMA_VERSION:
        raise InputFileError(
            f"{path}: schema {choice.schema_version} is newer than {SCHEMA_VERSION}, which this version reads; "
            "upgrade pix2face"
        )
    n_expected, n_found = SCHEMES.get(choice.scheme), len(choice.vertices)
    if n_found != n_expected:
        raise InputFileError(f"{path}: expected the {n_expected} vertices of {choice.scheme}, found {n_found}")
    if len(choice.offsets_mm) not in (0, n_expected):
        raise InputFileError(
            f"{path}: expected the offsets of {n_expected} landmarks, or none, found {len(choice.offsets_mm)}"
        )
    return choice


def open_model_with(name_or_path: str, landmarks: Path | None) -> MorphableModel:
    """Opens a model, with the landmarks of a file instead of its own if a file is given.

    Raises:
        Pix2FaceError: As ``open_model`` and ``with_landmarks``.
    """
    model = open_model(name_or_path)
    return model if landmarks is None else with_landmarks(model, landmarks)


def with_landmarks(model: MorphableModel, path: Path) -> MorphableModel:
    """The model with the landmarks of a file instead of its own of the same scheme.

    Landmarks of ``ibug68`` also take the place of those of ``ibug68-2d``: who chose them wants them for both types.

    Raises:
        InputFileError: As ``load_landmarks``, or a vertex that the model does not have.
        ModelMismatchError: The file was made for another model.
    """
    choice = load_landmarks(path)
    if choice.model.sha256 != model.sha256:
        raise ModelMismatchError(
            f"{path}: landmarks of the model {choice.model.name} ({choice.model.sha256[:12]}), found "
            f"{model.name} ({model.sha256[:12]}); choose them again with `pix2face landmarks select`"
        )
    if choice.scheme == IBUG68:
        others = {scheme: vertices for scheme, vertices in model.landmarks.items() if scheme != IBUG68_2D}
        model = replace(model, landmarks=MappingProxyType(others))
    try:
        return with_vertices(model, choice.scheme, choice.vertices, choice.offsets_mm)
    except UsageError as error:
        raise InputFileError(f"{path}: {error}") from error


def with_vertices(
    model: MorphableModel, scheme: str, vertices: Sequence[int], offsets_mm: Sequence[Offset] = ()
) -> MorphableModel:
    """The model with other vertices for the landmarks of a scheme, and offsets from them, if there are any.

    Raises:
        UsageError: It has no such vertex, or there is another number of offsets.
    """
    chosen = np.array(vertices)
    if not ((chosen >= 0) & (chosen < len(model.mean))).all():
        raise UsageError(f"expected vertices of 0 to {len(model.mean) - 1}, found {chosen.max()}")
    if offsets_mm and len(offsets_mm) != len(vertices):
        raise UsageError(f"expected an offset for each of {len(vertices)} landmarks, found {len(offsets_mm)}")
    offsets = np.array(offsets_mm or np.zeros((len(vertices), 3)), dtype=np.float64)
    return replace(
        model,
        landmarks=MappingProxyType({**model.landmarks, scheme: chosen.astype(np.int32)}),
        landmark_offsets_mm=MappingProxyType({**model.landmark_offsets_mm, scheme: offsets}),
    )


def with_own_landmarks(model: MorphableModel, header: CheckpointHeader) -> MorphableModel:
    """The model with the landmarks that a network brings along, if it has any, instead of its own.

    Raises:
        ModelMismatchError: The network was trained for another model.
        UsageError: The model has no such vertex.
    """
    header.check_model(model.name, model.sha256)
    for scheme, vertices in header.landmarks.items():
        model = with_vertices(model, scheme, vertices, header.landmark_offsets_mm.get(scheme, ()))
    return model
