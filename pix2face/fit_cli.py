"""The command ``pix2face fit``: photographs in; camera, coefficients, mesh and landmarks out."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, final

import numpy as np
import tyro
from rich.console import Console

from pix2face.command_line import prepare_output_folder
from pix2face.crops import crop_image
from pix2face.errors import UsageError
from pix2face.face_options import FaceOptions
from pix2face.fit_files import fit_to_json
from pix2face.fit_pictures import draw_overlay, write_mesh, write_point_cloud
from pix2face.fitting.coefficient_fit import PREDICTED_MAPS_REGULARISATION
from pix2face.fitting.face_fit import CameraKind
from pix2face.photograph_jobs import (
    SeenFace,
    check_photographs,
    for_each_face,
    write_maps_picture,
    write_picture,
)


@final
@dataclass(frozen=True)
class FitConfig:
    """Configuration of ``pix2face fit``."""

    images: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Photographs."""
    faces: Annotated[FaceOptions, tyro.conf.arg(name="")] = field(default_factory=FaceOptions)
    """Network, model and face boxes."""
    out: Path = Path("out/fit")
    """Folder for fits, meshes, point clouds and overlays."""
    camera: CameraKind = "weak-perspective"
    """Camera of the fit; the principal point of a pinhole is the centre of the photograph."""
    regularisation: float = PREDICTED_MAPS_REGULARISATION
    """Tikhonov weight of the coefficients, in mm^2."""


def fit(config: Annotated[FitConfig, tyro.conf.arg(name="")]) -> int:
    """Fit camera, coefficients and landmarks to every face: NAME.json, .obj, .ply, -maps.png, -overlay.jpg."""
    check_photographs(config.images)
    config.faces.check()
    if not 0 < config.regularisation < np.inf:
        raise UsageError(f"expected a positive --regularisation in mm^2, found {config.regularisation}")
    pix2face = config.faces.open()
    prepare_output_folder(config.out)
    model = pix2face.model

    def use(face: SeenFace) -> None:
        height, width = face.image.shape[:2]
        fitted = pix2face.fit_prediction(
            face.prediction, (height, width), camera=config.camera, regularisation=config.regularisation
        )
        overlay = draw_overlay(face.image, fitted, model)  # may fail: before anything is written
        (config.out / f"{face.name}.json").write_text(fit_to_json(fitted, model))
        write_mesh(config.out / f"{face.name}.obj", fitted, model)
        crop = crop_image(face.image, face.prediction.crop)
        write_point_cloud(config.out / f"{face.name}.ply", face.prediction.maps, crop)
        write_maps_picture(config.out, face)
        write_picture(config.out / f"{face.name}-overlay.jpg", overlay)

    console = Console(stderr=True)
    return for_each_face(config.images, config.faces, pix2face, console, use).report(console, config.out)
