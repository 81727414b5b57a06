"""Readers of published models, one file each: a ``StoredModel`` in mm, in the frame in which it was published.

``pix2face.model_formats.model_import`` brings it to the project's frame.
"""

from pathlib import Path

from pix2face.errors import InputFileError
from pix2face.files.checked_hdf5 import open_hdf5, read_text
from pix2face.files.mat_files import is_mat
from pix2face.files.npz_files import npz_names
from pix2face.files.opening import is_folder, open_regular
from pix2face.model_formats.bfm2009 import ORIGINAL_FILE, SHAPE_FILE, is_bfm2009, read_bfm2009
from pix2face.model_formats.bfm_front import is_bfm_front, read_bfm_front
from pix2face.model_formats.flame import read_flame
from pix2face.model_formats.gnm import TEMPLATE, read_gnm
from pix2face.model_formats.ict_facekit import model_folder, read_ict_facekit
from pix2face.model_formats.statismo import is_statismo, read_statismo
from pix2face.model_formats.surrey import is_surrey, read_surrey
from pix2face.models.model_file import FORMAT, StoredModel

SUPPORTED = (
    f"a folder with {SHAPE_FILE} and Model_Expression.mat, or with {ORIGINAL_FILE} (BFM 2009), a BFM.mat of face3d, "
    "a BFM_model_front.mat, a .h5 in statismo's "
    "layout (BFM 2017, 2019), a .pkl of FLAME, a .bin of Surrey, a folder of ICT-FaceKit, or a .npz of GNM"
)
# The Basel Face Model of 2009 takes 0.25 GB.
LARGEST_FILE_BYTES = 1 << 30
_FIRST_BYTES = 512
_HDF5, _ZIP = b"\x89HDF\r\n\x1a\n", b"PK\x03\x04"
# Protocol 2 and later start with the first; protocols 0 and 1, a dictionary, with the others.
_PICKLE_STARTS = (b"\x80", b"(d", b"}")


def read_model(path: Path) -> StoredModel:
    """Reads a published model: a file, or the folder of one that comes as several files.

    Its format is recognised by content, not by name.

    Returns:
        The model in mm, in its published frame and winding. A landmark is -1 where the published list lacks it.

    Raises:
        InputFileError: The path is missing, or holds no supported model, or a damaged or hostile one.
    """
    if is_folder(path):
        return _read_folder(path)
    with open_regular(path, SUPPORTED, LARGEST_FILE_BYTES) as file:
        start = file.read(_FIRST_BYTES)
    if start.startswith(_HDF5):
        return _read_hdf5(path)
    if start.startswith(_ZIP):
        return _read_zip(path)
    if is_mat(start):
        return _read_mat(path)
    if start.startswith(_PICKLE_STARTS):
        return read_flame(path)
    if is_surrey(start):
        return read_surrey(path)
    if path.suffix == ".obj" and model_folder(path) is not None:
        return read_ict_facekit(path)
    raise InputFileError(f"{path}: expected {SUPPORTED}; found a file that starts with {start[:16]!r}")


def _read_folder(folder: Path) -> StoredModel:
    if any(folder.glob("*MorphableModel.mat")) or any(folder.glob("Model_*.mat")):
        return read_bfm2009(folder)
    if model_folder(folder) is not None:
        return read_ict_facekit(folder)
    names = sorted(entry.name for entry in folder.iterdir())[:10]
    raise InputFileError(
        f"{folder}: expected {SUPPORTED}; found a folder with {', '.join(names) or 'nothing'}; models of one file are "
        "imported by the path of that file"
    )


def _read_hdf5(path: Path) -> StoredModel:
    with open_hdf5(path) as file:
        if "format" in file.attrs and read_text(file.attrs, path, "format") == FORMAT:
            raise InputFileError(f"{path}: expected a published model, found one that is imported already; use it")
        if not is_statismo(file):
            raise InputFileError(f"{path}: expected {SUPPORTED}; found an HDF5 file with {sorted(file)[:10]}")
    return read_statismo(path)


def _read_zip(path: Path) -> StoredModel:
    names = npz_names(path, LARGEST_FILE_BYTES)
    if TEMPLATE not in names:
        raise InputFileError(f"{path}: expected {SUPPORTED}; found an archive with {list(names)[:10]}")
    return read_gnm(path)


def _read_mat(path: Path) -> StoredModel:
    if is_bfm_front(path):
        return read_bfm_front(path)
    if not is_bfm2009(path):
        raise InputFileError(
            f"{path}: expected {SUPPORTED}; found a MAT file that is no model (a coefficient file, perhaps)"
        )
    return read_bfm2009(path)
