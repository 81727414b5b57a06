"""Where faces come from: a table of coefficients, or a folder of 300W-LP files.

With an imported BFM 2009, the coefficients of 300W-LP's files are the geometry. To any other model they mean nothing,
so that model is fitted to the landmarks of each file instead (retargeting).
"""

import hashlib
import json
from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import final

import numpy as np

from datagen.faces.face_checks import check_face, landmark_model_of
from datagen.faces.retarget import Retargeter
from pix2face.errors import InputFileError, ModelMismatchError, SampleRejectedError, UsageError
from pix2face.face_files.annotations import picture_beside
from pix2face.face_files.coefficients import Face, FaceCoefficients, load_coefficients
from pix2face.face_files.w300lp import N_LIGHTING, camera_of_pose, check_picture_height, read_coefficient_file
from pix2face.files.images import read_size_px
from pix2face.files.opening import walk_files
from pix2face.geometry.believable_face import GIVEN, PROJECTED
from pix2face.model_formats.bfm2009 import standard_deviations_of_300wlp
from pix2face.models.morphable_model import MorphableModel

LANDMARK_FOLDER = "landmarks"


class FaceSource(ABC):
    """A sequence of faces of one model."""

    sample_ids: tuple[str, ...]  # unique names, in the order of work
    licence: str  # terms of the data that the faces come from
    # tells this source from another of the same name: hash of a table's content, or of a folder's names and file sizes
    sha256: str
    n_lighting: int = 0  # how many numbers describe the lighting of a face; 0 if it is unknown
    has_photographs: bool  # whether at least some of the faces have photographs
    lacks_photographs: bool  # whether at least some have none

    @abstractmethod
    def face(self, index: int) -> Face:
        """Reads or fits one face.

        Raises:
            SampleRejectedError: The face cannot be used; the message says why.
        """


def open_source(path: Path, model: MorphableModel) -> FaceSource:
    """Opens a table (.h5) or a folder of 300W-LP or AFLW2000-3D files.

    Raises:
        UsageError: Nothing is there, or the folder holds no coefficient file.
        InputFileError: The table cannot be read.
        ModelMismatchError: The table belongs to another model.
    """
    if path.is_dir():
        return W300LPFolder(path, model)
    if path.is_file():
        return TableSource(path, model)
    raise UsageError(
        f"{path}: expected a folder of 300W-LP files or a table of coefficients (.h5), found nothing there"
    )


@final
class TableSource(FaceSource):
    """The faces of a coefficient table."""

    def __init__(self, path: Path, model: MorphableModel) -> None:
        self._table: FaceCoefficients = load_coefficients(path)
        self._folder = path.parent
        if self._table.model_sha256 != model.sha256:
            raise ModelMismatchError(
                f"{path}: coefficients belong to model {self._table.model_name} ({self._table.model_sha256[:12]}), "
                f"found model {model.name} ({model.sha256[:12]}); give the former with --model"
            )
        found = self._table.identity.shape[1], self._table.expression.shape[1]
        if found != (model.n_identity, model.n_expression):
            raise InputFileError(
                f"{path}: expected {model.n_identity} identity and {model.n_expression} expression coefficients for "
                f"model {model.name}, found {found[0]} and {found[1]}; make the table again with `datagen sample`"
            )
        self.sample_ids = self._table.sample_ids
        self.licence = self._table.licence or model.licence
        self.n_lighting = 0 if self._table.lighting is None else self._table.lighting.shape[1]
        self.has_photographs = any(self._table.image_paths)
        self.lacks_photographs = not all(self._table.image_paths)
        self._landmark_model = landmark_model_of(model)
        self.sha256 = _table_sha256(self._table)

    def face(self, index: int) -> Face:
        """Reads one row of the table. A photograph must have the size that the row says, and show a possible face."""
        face = self._table.face(index, self._folder)
        if face.image_path is not None:
            try:
                size_px = read_size_px(face.image_path)
            except InputFileError as error:
                raise SampleRejectedError(str(error)) from error
            if size_px != (face.height_px, face.width_px):
                raise SampleRejectedError(
                    f"{face.image_path}: expected a picture of {face.width_px} x {face.height_px} pixels, as the table "
                    f"says, found {size_px[1]} x {size_px[0]}"
                )
            check_face(face, self._landmark_model, GIVEN)
        return face


@final
class W300LPFolder(FaceSource):
    """The faces of a folder of 300W-LP or AFLW2000-3D, including its subfolders.

    Args:
        folder: The files with a picture beside each, as distributed.
        model: BFM 2009 takes over the coefficients of the files; any other model is fitted to their landmarks.
    """

    n_lighting = N_LIGHTING
    has_photographs, lacks_photographs = True, False

    def __init__(self, folder: Path, model: MorphableModel) -> None:
        self._folder = folder
        self._deviations = standard_deviations_of_300wlp(model)
        self._retargeter = None if self._deviations else Retargeter(model, folder)
        self._landmark_model = landmark_model_of(model)
        paths = coefficient_paths(folder)
        if not paths:
            raise UsageError(
                f"{folder}: expected .mat files of 300W-LP or AFLW2000-3D beside their pictures, found none"
            )
        self._paths = paths
        self.sample_ids = tuple(path.relative_to(folder).with_suffix("").as_posix() for path in paths)
        self.sha256 = folder_sha256(self.sample_ids, map(self._files_of, paths))
        self.licence = f"pictures: 300W-LP / AFLW2000-3D, research use only; model: {model.licence}"

    def face(self, index: int) -> Face:
        """Reads one file with its picture, and fits the model unless the coefficients are its own."""
        path = self._paths[index]
        if not is_text(self.sample_ids[index]):
            raise SampleRejectedError(f"{path}: expected a file name in UTF-8, which shards can hold; rename it")
        try:
            file = read_coefficient_file(path)
            image_path = picture_beside(path)
            size_px = read_size_px(image_path)
            check_picture_height(file, size_px[0])
        except InputFileError as error:
            raise SampleRejectedError(str(error)) from error
        if self._retargeter is not None:
            identity, expression, camera, method = self._retargeter.fit(file, size_px[0])
        else:
            assert self._deviations is not None
            identity, expression = file.identity / self._deviations[0], file.expression / self._deviations[1]
            camera, method = camera_of_pose(file.pose, size_px[0]), "coefficients of the file"
        if file.pose.scale < 0:
            method += ", negative scale undone"
        face = Face(
            sample_id=self.sample_ids[index],
            identity=identity.astype(np.float32),
            expression=expression.astype(np.float32),
            camera=camera,
            height_px=size_px[0],
            width_px=size_px[1],
            image_path=image_path,
            attributes={"geometry": method},
            lighting=file.lighting,
        )
        check_face(face, self._landmark_model, GIVEN if self._retargeter is None else PROJECTED)
        return face

    def _files_of(self, path: Path) -> tuple[Path | None, ...]:
        """The files that the content of a sample depends on."""
        landmarks = (self._retargeter.landmark_path(path),) if self._retargeter else ()
        return path, picture_of(path), *landmarks


def _table_sha256(table: FaceCoefficients) -> str:
    digest = hashlib.sha256(json.dumps([table.sample_ids, table.image_paths, table.attributes]).encode())
    for values in (table.identity, table.expression, table.cameras, table.sizes_px):
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


def folder_sha256(sample_ids: tuple[str, ...], files: Iterable[Sequence[Path | None]]) -> str:
    """The hash that tells a folder from another: of the names of its faces and the sizes of their files.

    Sizes cost nothing to read and stay the same in a copy of the folder. To hash contents, all of them would have to be
    read before the first picture is drawn; times differ from copy to copy. For each face, ``files`` are those that it
    depends on; None stands for one that is missing.
    """
    sizes = [[_size_bytes(path) for path in of_one] for of_one in files]
    return hashlib.sha256(json.dumps([sample_ids, sizes]).encode()).hexdigest()


def picture_of(path: Path) -> Path | None:
    """The picture beside a file, or None."""
    try:
        return picture_beside(path)
    except InputFileError:
        return None


def _size_bytes(path: Path | None) -> int | None:
    """The size of a file; None if it is missing or cannot be read."""
    try:
        return None if path is None else path.stat().st_size
    except (OSError, ValueError):
        return None


def is_text(name: str) -> bool:
    """Tells names that UTF-8 can hold. On Linux, other bytes of file names become lone surrogates."""
    return not any("\ud800" <= character <= "\udfff" for character in name)


def coefficient_paths(folder: Path) -> list[Path]:
    """All .mat files except landmark files, sorted. Links to folders are not followed, since they may form loops."""
    paths = walk_files(folder, (".mat",), left_out=(LANDMARK_FOLDER,))
    return sorted(path for path in paths if not path.name.lower().endswith("_pts.mat"))
