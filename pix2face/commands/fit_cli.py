"""The command ``pix2face fit``: photographs in; camera, coefficients, mesh and landmarks out."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, final

import tyro
from rich.console import Console

from pix2face.command_line import check_output_folder, prepare_output_folder
from pix2face.commands.face_options import FaceFinder, PhotographOptions
from pix2face.commands.photograph_jobs import (
    Photograph,
    SeenFace,
    Tally,
    check_photographs,
    for_each_face,
    located,
    write_maps_picture,
    write_picture,
)
from pix2face.errors import DegenerateGeometryError, InputFileError, UsageError
from pix2face.fitting.face_fit import FaceFit
from pix2face.fitting.fit_options import DEFAULT_FIT, FitOptions
from pix2face.geometry.crops import crop_image
from pix2face.models.morphable_model import MorphableModel
from pix2face.photographs.fit_files import write_fit
from pix2face.photographs.fit_pictures import draw_overlay, write_point_cloud
from pix2face.photographs.mesh_files import FaceMesh, parse_mesh_formats, write_mesh
from pix2face.photographs.texture import face_texture, vertex_colours

Colour = Literal["auto", "none", "vertex", "texture"]


@final
@dataclass(frozen=True)
class FitConfig:
    """Configuration of ``pix2face fit``.

    Attributes:
        images: Photographs.
        faces: Network, model and face boxes.
        out: Folder for fits, meshes, point clouds and overlays.
        how: Camera and coefficients.
        joint: Fit one identity to all photographs, and an expression to each; they must show one person (the largest
            face counts).
        mesh: Formats of the mesh, separated by commas: obj, ply, glb; or none.
        colour: Colours of the mesh, from the photograph: vertex, texture or none; auto takes a texture where the model
            has texture coordinates, else vertex colours. A .ply has vertex colours in place of a texture.
    """

    images: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(help_behavior_hint="(required)")]
    faces: Annotated[PhotographOptions, tyro.conf.arg(name="")] = PhotographOptions()
    out: Path = Path("out/fit")
    how: Annotated[FitOptions, tyro.conf.arg(name="")] = DEFAULT_FIT
    joint: bool = False
    mesh: str = "obj,glb"
    colour: Colour = "auto"


def fit(config: Annotated[FitConfig, tyro.conf.arg(name="")]) -> int:
    """Fit camera, coefficients and landmarks to every face: NAME.json, mesh, -points.ply, -maps.png, -overlay.jpg."""
    config.faces.check()
    formats = parse_mesh_formats(config.mesh)
    config.how.check()
    if config.joint and config.how.reprojection_rounds:
        raise UsageError("expected no --reprojection-rounds with --joint, whose fits have no more rounds")
    check_photographs(config.images, Console(stderr=True))
    check_output_folder(config.out)
    finder = config.faces.open()
    model = finder.pix2face.model
    if config.colour == "texture" and model.uv is None:
        raise UsageError(
            f"expected texture coordinates in the model {model.name!r} for --colour texture, found none; "
            "take --colour vertex"
        )
    prepare_output_folder(config.out)
    run = _fit_jointly if config.joint else _fit_each
    return run(config, formats, finder).report(Console(stderr=True), config.out)


def _fit_each(config: FitConfig, formats: tuple[str, ...], finder: FaceFinder) -> Tally:
    pix2face = finder.pix2face

    def use(face: SeenFace) -> None:
        fitted = pix2face.fit_prediction(face.prediction, face.size_px, config.how)
        _write(config, formats, face, fitted, pix2face.model)

    return for_each_face(config.images, finder, Console(stderr=True), use)


def _fit_jointly(config: FitConfig, formats: tuple[str, ...], finder: FaceFinder) -> Tally:
    """Two passes: maps of all photographs, of which only the maps are kept, then one fit, then what is written."""
    seen: list[SeenFace] = []
    pix2face = finder.pix2face

    def keep(face: SeenFace) -> None:
        pix2face.fit_prediction(face.prediction, face.size_px, config.how)  # a face that cannot be fitted is left out
        seen.append(face.without_image())

    tally = for_each_face(config.images, finder.only_largest(), Console(stderr=True), keep)
    if not seen:
        return tally
    fits = pix2face.fit_predictions_joint(
        [face.prediction for face in seen], [face.size_px for face in seen], config.how
    )
    for face, fitted in zip(seen, fits, strict=True):
        try:
            _write(config, formats, face.with_image(), fitted, pix2face.model)
        except (DegenerateGeometryError, InputFileError) as error:  # of the overlay; the photograph is gone
            tally.n_faces -= 1
            tally.problems.append(located(error, face.path))
    return tally


def _write(config: FitConfig, formats: tuple[str, ...], face: SeenFace, fitted: FaceFit, model: MorphableModel) -> None:
    overlay = draw_overlay(face.image, fitted, model)  # may fail: before anything is written
    mesh = _coloured(config.colour, formats, face.image, fitted, model)
    for name in formats:
        write_mesh(config.out / f"{face.name}.{name}", mesh)
    write_fit(config.out / f"{face.name}.json", fitted, model, face.path, face.size_px[0])
    crop = crop_image(face.image, face.prediction.crop)
    write_point_cloud(config.out / f"{face.name}-points.ply", face.prediction.maps, crop)
    write_maps_picture(config.out, face)
    write_picture(config.out / f"{face.name}-overlay.jpg", overlay)


def _coloured(
    colour: Colour, formats: tuple[str, ...], image: Photograph, fitted: FaceFit, model: MorphableModel
) -> FaceMesh:
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
