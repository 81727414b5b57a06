"""The command ``pix2face predict``, which writes the maps of faces in photographs."""

from rich.console import Console

from pix2face.command_line import check_output_folder
from pix2face.commands.face_finder import open_finder
from pix2face.commands.given_files import given_files
from pix2face.commands.photograph_jobs import Tally, look_at, write_maps_picture
from pix2face.commands.pix2face_config import PredictConfig
from pix2face.commands.result_folder import ResultFolder
from pix2face.photographs.map_files import MAP_FORMATS, parse_formats

# Side of the largest maps. PNCC and offset of this size take 0.4 GB.
LARGEST_MAPS_PX = 4096


def predict(config: PredictConfig) -> int:
    """Runs ``pix2face predict``."""
    config.faces.check()
    formats, console = parse_formats(config.format), Console(stderr=True)
    images = given_files(config.images, console)
    check_output_folder(config.out)
    finder = open_finder(config.faces, needs_model=False)
    results, tally = ResultFolder(config.out, "predict"), Tally()
    for photograph in look_at(images, finder, console, tally):
        with results.of_photograph(photograph.name, photograph.path) as folder:
            for face in photograph.faces:
                prediction = face.prediction
                if config.resolution == "photograph":
                    prediction = prediction.smooth(min(prediction.crop.finest_size_px, LARGEST_MAPS_PX))
                with tally.face(face.path):
                    for name in formats:
                        MAP_FORMATS[name](folder, face.name, prediction)
                    write_maps_picture(folder, face)
    return tally.report(console, config.out)
