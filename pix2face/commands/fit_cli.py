"""The command ``pix2face fit``, which fits camera, coefficients, mesh and landmarks to faces in photographs."""

import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

from rich.console import Console

from pix2face.api import Pix2Face
from pix2face.command_line import check_output_folder
from pix2face.commands.face_finder import open_finder
from pix2face.commands.given_files import given_files
from pix2face.commands.photograph_jobs import (
    Photograph,
    SeenFace,
    SeenPhotograph,
    Tally,
    located,
    look_at,
    write_maps_picture,
)
from pix2face.commands.pix2face_config import Colour, FitConfig
from pix2face.commands.result_folder import ResultFolder
from pix2face.errors import DegenerateGeometryError, InputFileError, UsageError
from pix2face.files.images import write_picture
from pix2face.files.meshes.ply import encode_ply
from pix2face.files.writing import write_file
from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.other_cameras import gltf_camera
from pix2face.photographs.fit_files import fit_to_json
from pix2face.photographs.fit_pictures import draw_overlay, photograph_cloud
from pix2face.photographs.landmark_visibility import landmarks_in_sight
from pix2face.photographs.mesh_files import FaceMesh, parse_mesh_formats, write_mesh
from pix2face.photographs.texture import face_texture, vertex_colours


def fit(config: FitConfig) -> int:
    """Runs ``pix2face fit``."""
    config.faces.check()
    formats = parse_mesh_formats(config.mesh)
    config.how.check()
    if config.joint and config.how.reprojection_rounds:
        raise UsageError("expected no --reprojection-rounds with --joint, whose fits have no more rounds")
    console = Console(stderr=True)
    images = given_files(config.images, console)
    check_output_folder(config.out)
    finder = open_finder(config.faces)
    model = finder.pix2face.model
    if config.colour == "texture" and model.uv is None:
        raise UsageError(
            f"expected texture coordinates in the model {model.name!r} for --colour texture, found none; "
            "take --colour vertex"
        )
    writer = _Writer(config, formats, ResultFolder(config.out, "fit"))
    tally = Tally()
    if config.joint:
        _fit_jointly(look_at(images, replace(finder, largest=True), console, tally), tally, finder.pix2face, writer)
    else:
        _fit_each(look_at(images, finder, console, tally), tally, finder.pix2face, writer)
    return tally.report(console, config.out)


def _fit_each(photographs: Iterable[SeenPhotograph], tally: Tally, pix2face: Pix2Face, writer: "_Writer") -> None:
    for photograph in photographs:
        with writer.results.of_photograph(photograph.name, photograph.path) as folder:
            for face in photograph.faces:
                with tally.face(face.path):
                    fitted = pix2face.fit_prediction(face.prediction, face.size_px, writer.config.how)
                    writer.write(folder, face, fitted)
                    tally.check_plausible(fitted, face)


def _fit_jointly(photographs: Iterable[SeenPhotograph], tally: Tally, pix2face: Pix2Face, writer: "_Writer") -> None:
    """Predicts the maps of all photographs, fits one identity to them, and reads each photograph again to write."""
    seen: dict[str, SeenFace] = {}  # by the name of the photograph
    how = writer.config.how
    for photograph in photographs:
        for face in photograph.faces:
            with tally.face(face.path):
                pix2face.fit_prediction(face.prediction, face.size_px, how)  # leaves out faces that cannot be fitted
                seen[photograph.name] = face.without_image()
        if photograph.name not in seen:
            with writer.results.of_photograph(photograph.name, photograph.path):
                pass  # removes the files of an earlier run
    if not seen:
        return
    faces = list(seen.values())
    fits = pix2face.fit_predictions_joint([own.prediction for own in faces], [own.size_px for own in faces], how)
    for (name, face), fitted in zip(seen.items(), fits, strict=True):
        try:
            with writer.results.of_photograph(name, face.path) as folder:
                writer.write(folder, face.with_image(), fitted)
                tally.check_plausible(fitted, face)
        except (DegenerateGeometryError, InputFileError) as error:  # no overlay can be drawn, or the file is gone
            tally.n_faces -= 1
            tally.problems.append(located(error, face.path))


@final
@dataclass(frozen=True, eq=False)
class _Writer:
    """Writes the files of faces."""

    config: FitConfig
    formats: tuple[str, ...]  # of the mesh
    results: ResultFolder

    def write(self, folder: Path, face: SeenFace, fitted: FaceFit) -> None:
        """Writes the files of a face to a temporary folder."""
        in_sight = landmarks_in_sight(fitted, face.prediction.maps, face.prediction.crop)
        overlay = draw_overlay(face.image, fitted, in_sight=in_sight)  # first, since it may fail
        mesh = _coloured(self.config.colour, self.formats, face.image, fitted)
        mesh = replace(mesh, camera=gltf_camera(fitted.camera, face.size_px))
        for name in self.formats:
            write_mesh(folder / f"{face.name}.{name}", mesh)
        way = os.path.relpath(face.path.absolute(), self.results.path.absolute())
        write_file(folder / f"{face.name}.json", fit_to_json(fitted, way, face.size_px))
        points, colours = photograph_cloud(face.image, face.prediction.crop, face.prediction.maps)
        write_file(folder / f"{face.name}-points.ply", encode_ply(points, colours))
        write_maps_picture(folder, face)
        write_picture(folder / f"{face.name}-overlay.jpg", overlay)


def _coloured(colour: Colour, formats: tuple[str, ...], image: Photograph, fitted: FaceFit) -> FaceMesh:
    model = fitted.model
    wants_texture = colour == "texture" or (colour == "auto" and model.uv is not None)
    wants_vertices = not wants_texture or "ply" in formats
    if not formats or colour == "none":
        return FaceMesh(fitted.vertices, model)
    return FaceMesh(
        fitted.vertices,
        model,
        vertex_colours(image, fitted, model) if wants_vertices else None,
        face_texture(image, fitted, model) if wants_texture else None,
    )
