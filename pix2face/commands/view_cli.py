"""The command ``pix2face view``, which writes a page that shows fitted faces in 3D."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray
from rich.console import Console

from pix2face.command_line import check_output_file, counted, say
from pix2face.commands.face_finder import open_finder
from pix2face.commands.given_files import given_files
from pix2face.commands.photograph_jobs import Tally, located, look_at
from pix2face.commands.pix2face_config import ViewConfig
from pix2face.errors import DegenerateGeometryError, InputFileError, UsageError
from pix2face.files.images import read_photograph
from pix2face.files.opening import is_regular, open_regular
from pix2face.models.morphable_model import MorphableModel, open_model
from pix2face.photographs.fit_files import read_fit
from pix2face.photographs.fit_pictures import photograph_cloud
from pix2face.photographs.view_page import ViewedFace, ViewPages, face_data

# Point clouds of `pix2face fit` take about a megabyte.
LARGEST_CLOUD_BYTES = 64 << 20


def view(config: ViewConfig) -> int:
    """Runs ``pix2face view``."""
    config.faces.check()
    config.how.check()
    check_output_file(config.out, (".html",))
    console = Console(stderr=True)
    inputs = given_files(config.inputs, console, " or a fit (.json)")
    pages = ViewPages(config.out, f"pix2face: {inputs[0].stem}")
    fits = [path for path in inputs if path.suffix.lower() == ".json"]
    photographs = [path for path in inputs if path.suffix.lower() != ".json"]
    if fits and config.faces.faces.network.landmarks is not None:
        raise UsageError(
            f"--landmarks: expected photographs alone, found {fits[0]}, which keeps the landmarks it was written with; "
            "give --landmarks to `pix2face fit`"
        )
    tally = _fit_photographs(config, photographs, console, pages.add) if photographs else Tally()
    if fits:
        model = open_model(config.faces.faces.network.model)
        for path in fits:
            try:
                pages.add(face_data(_stored_face(path, model)))
                tally.n_faces += 1
            except (InputFileError, DegenerateGeometryError) as error:
                tally.problems.append(located(error, path))
    pages.close()
    if not pages.paths:
        say(console, f"no face to show: {config.out} is not written")
    elif len(pages.paths) > 1:
        say(console, f"{counted(len(pages.paths), 'page')}, which lead to each other: the last is {pages.paths[-1]}")
    tally.n_photographs = len(inputs)
    return tally.report(console, config.out)


def _fit_photographs(
    config: ViewConfig, photographs: list[Path], console: Console, show: Callable[[str], None]
) -> Tally:
    finder, tally = open_finder(config.faces), Tally()
    pix2face = finder.pix2face
    for photograph in look_at(photographs, finder, console, tally):
        for face in photograph.faces:
            with tally.face(face.path):
                fitted = pix2face.fit_prediction(face.prediction, face.size_px, config.how)
                tally.check_plausible(fitted, face)
                points, colours = photograph_cloud(face.image, face.prediction.crop, face.prediction.maps)
                show(face_data(ViewedFace(face.name, face.image, fitted, points, colours)))
    return tally


def _stored_face(path: Path, model: MorphableModel) -> ViewedFace:
    """Reads a fit with its photograph and, if it lies beside the fit, its point cloud.

    Raises:
        InputFileError: The fit or its photograph cannot be read.
        ModelMismatchError: The fit is of another model.
    """
    fit, photograph = read_fit(path, model)
    points, colours = _stored_points(path.with_name(f"{path.stem}-points.ply"))
    return ViewedFace(path.stem, read_photograph(photograph), fit, points, colours)


def _stored_points(path: Path) -> tuple[Float32[ndarray, "n 3"], UInt8[ndarray, "n 3"]]:
    if not is_regular(path):
        return np.zeros((0, 3), dtype=np.float32), np.zeros((0, 3), dtype=np.uint8)
    import trimesh  # here, since it takes more than a second and photographs do not need it

    try:
        # trimesh converts the content of damaged files unchecked, and NumPy would warn.
        with open_regular(path, "a point cloud", LARGEST_CLOUD_BYTES) as file, np.errstate(all="ignore"):
            cloud = trimesh.load(file, file_type="ply")
        if not isinstance(cloud, trimesh.PointCloud):
            raise TypeError("a mesh")
        points, colours = np.asarray(cloud.vertices, dtype=np.float32), np.asarray(cloud.colors)[:, :3]
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, OSError) as error:
        raise InputFileError(f"{path}: expected a point cloud that `pix2face fit` wrote, found another file") from error
    return points, colours.astype(np.uint8)
