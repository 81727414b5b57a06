"""Writes a table of coefficients face by face, so that memory does not grow with the number of faces."""

import os
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, final

import h5py
import numpy as np
from numpy import ndarray

from pix2face.face_files.coefficients import Face, write_table_header
from pix2face.files.hdf5_writing import UnfailingFile
from pix2face.files.text_columns import json_lines
from pix2face.files.writing import written_in_one_step

# Faces that wait in memory, and a chunk of the file.
FACES_AT_ONCE = 1024
REJECTED_AT_ONCE = 256
TEXT_BYTES_AT_ONCE = 1 << 16


@final
@dataclass(frozen=True, kw_only=True)
class TableHeader:
    """What holds for all faces of a table: the model of the coefficients, and how many numbers each face has."""

    model_name: str
    model_sha256: str
    n_identity: int
    n_expression: int
    n_lighting: int = 0  # 0 where the source does not describe the lighting
    licence: str = ""  # terms of the source
    configuration: str = "{}"  # how the table is made, as JSON


@final
class CoefficientWriter:
    """Writes faces in the order in which they come. Paths of photographs are stored relative to the table's folder.

    The file appears under its name when the context ends. After an exception, an older file of that name stays.
    """

    def __init__(self, path: Path, header: TableHeader) -> None:
        self.n_faces = 0
        self._path, self._header = path, header
        self._waiting: list[Face] = []
        self._rejected: list[tuple[str, str]] = []

    def __enter__(self) -> "CoefficientWriter":
        header = self._header
        with ExitStack() as stack:
            temporary = stack.enter_context(written_in_one_step(self._path))
            self._unfailing = stack.enter_context(UnfailingFile(temporary))
            self._file = stack.enter_context(h5py.File(self._unfailing, "w", track_order=False))
            write_table_header(self._file, header)
            self._create("identity", (header.n_identity,), np.float32)
            self._create("expression", (header.n_expression,), np.float32)
            self._create("cameras", (4, 4), np.float64)
            self._create("sizes_px", (2,), np.int32)
            if header.n_lighting:
                self._create("lighting", (header.n_lighting,), np.float32)
            for name in ("sample_ids", "image_paths", "attributes", "rejected"):
                self._file.create_dataset(
                    name, (0,), np.uint8, maxshape=(None,), chunks=(TEXT_BYTES_AT_ONCE,), track_times=False
                )
            self._open = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._open:
            if error is not None:
                raise error
            self._flush()
            self._append("rejected", json_lines(self._rejected))

    def add(self, face: Face) -> None:
        """Adds a face."""
        self._waiting.append(face)
        self.n_faces += 1
        if len(self._waiting) >= FACES_AT_ONCE:
            self._flush()

    def reject(self, sample_id: str, reason: str) -> None:
        """Records a face of the source that cannot be used."""
        self._rejected.append((sample_id, reason))
        if len(self._rejected) >= REJECTED_AT_ONCE:
            self._append("rejected", json_lines(self._rejected))
            self._rejected = []

    def _create(self, name: str, shape: tuple[int, ...], dtype: Any) -> None:
        # Chunks of no bytes do not exist: a model without expressions has an empty column.
        chunk = (FACES_AT_ONCE, *(max(length, 1) for length in shape))
        self._file.create_dataset(
            name,
            (0, *shape),
            dtype,
            maxshape=(None, *shape),
            chunks=chunk if 0 not in shape else None,
            track_times=False,
        )

    def _flush(self) -> None:
        faces, self._waiting = self._waiting, []
        if not faces:
            return
        self._append("identity", np.stack([face.identity for face in faces]))
        self._append("expression", np.stack([face.expression for face in faces]))
        self._append("cameras", np.stack([face.camera.matrix for face in faces]))
        self._append("sizes_px", np.array([(face.height_px, face.width_px) for face in faces]))
        if self._header.n_lighting:
            unknown = np.full(self._header.n_lighting, np.nan)
            rows = [unknown if face.lighting is None else face.lighting for face in faces]
            self._append("lighting", np.stack(rows))
        self._append("sample_ids", json_lines(face.sample_id for face in faces))
        self._append("image_paths", json_lines(self._relative(face.image_path) for face in faces))
        self._append("attributes", json_lines(dict(face.attributes) for face in faces))

    def _append(self, name: str, values: ndarray) -> None:
        dataset = self._file[name]
        start = dataset.shape[0]
        dataset.resize(start + len(values), axis=0)
        if len(values):
            dataset[start:] = values
        self._unfailing.check()

    def _relative(self, image_path: Path | None) -> str:
        return "" if image_path is None else os.path.relpath(image_path, self._path.parent)
