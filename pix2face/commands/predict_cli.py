"""The command ``pix2face predict``: photographs in, maps out."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, final

import tyro
from rich.console import Console

from pix2face.command_line import check_output_folder
from pix2face.commands.face_options import PhotographOptions
from pix2face.commands.given_files import given_files
from pix2face.commands.photograph_jobs import Tally, look_at, write_maps_picture
from pix2face.commands.result_folder import ResultFolder
from pix2face.photographs.map_files import MAP_FORMATS, parse_formats


@final
@dataclass(frozen=True)
class PredictConfig:
    """Configuration of ``pix2face predict``.

    Attributes:
        images: Photographs: files, folders of them, or quoted patterns such as 'photos/*.jpg'.
        faces: Network, model and face boxes.
        out: Folder for the maps.
        format: Formats of the maps, separated by commas: npz, png16 (16-bit PNG), exr (32-bit OpenEXR).
    """

    images: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(help_behavior_hint="(required)")]
    faces: Annotated[PhotographOptions, tyro.conf.arg(name="")] = PhotographOptions()
    out: Path = Path("out/predict")
    format: str = "npz"


def predict(config: Annotated[PredictConfig, tyro.conf.arg(name="")]) -> int:
    """Predict the maps of every face (PNCC and offset in mm, mask), and draw them as NAME-0-maps.png."""
    config.faces.check()
    formats, console = parse_formats(config.format), Console(stderr=True)
    images = given_files(config.images, console)
    check_output_folder(config.out)
    finder = config.faces.open(needs_model=False)
    results, tally = ResultFolder(config.out, "predict"), Tally()
    for photograph in look_at(images, finder, console, tally):
        with results.of_photograph(photograph.name, photograph.path) as folder:
            for face in photograph.faces:
                with tally.face(face.path):
                    for name in formats:
                        MAP_FORMATS[name](folder, face.name, face.prediction)
                    write_maps_picture(folder, face)
    return tally.report(console, config.out)
