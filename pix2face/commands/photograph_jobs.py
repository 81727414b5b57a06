"""What the commands for photographs share: every face of every photograph gets a name and is handed on."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import final

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from rich.console import Console

from pix2face.command_line import EXIT_REJECTED, counted, progress_bar, say
from pix2face.commands.face_options import FaceFinder
from pix2face.errors import DegenerateGeometryError, InputFileError, UsageError
from pix2face.files.images import LARGEST_FILE_BYTES, read_photograph
from pix2face.files.opening import check_regular
from pix2face.files.writing import write_file
from pix2face.geometry.crops import crop_image
from pix2face.inference.predictor import Prediction
from pix2face.photographs.fit_pictures import draw_maps

Photograph = UInt8[ndarray, "h w 3"]


@final
@dataclass(frozen=True, eq=False)
class SeenFace:
    """One face of one photograph."""

    name: str  # what its files are called; no other face of the run has it
    path: Path  # the photograph's file
    image: Photograph
    prediction: Prediction
    size_px: tuple[int, int]  # height and width of the photograph

    def without_image(self) -> "SeenFace":
        """Returns the face without its photograph, so that many can be kept in memory."""
        return replace(self, image=np.zeros((0, 0, 3), dtype=np.uint8))

    def with_image(self) -> "SeenFace":
        """The same with its photograph read again.

        Raises:
            InputFileError: It is gone, or another one.
        """
        image = read_photograph(self.path)
        if image.shape[:2] != self.size_px:
            raise InputFileError(f"{self.path}: the photograph changed while it was worked on; run again")
        return replace(self, image=image)


@final
@dataclass(eq=False)
class Tally:
    """What a run did, and what it could not do."""

    n_photographs: int = 0
    n_faces: int = 0
    problems: list[str] = field(default_factory=list)

    def report(self, console: Console, where: Path) -> int:
        """Says it, and gives the exit status."""
        for problem in self.problems:
            say(console, problem)
        say(console, f"photographs: {self.n_photographs}, faces: {self.n_faces} -> {where}")
        return EXIT_REJECTED if self.problems else 0


def check_photographs(images: Sequence[Path], console: Console, expected: str = "a picture") -> None:
    """Looks for photographs before a network is loaded, which takes seconds; says at once which are not there.

    They do not end the run where others are there.

    Raises:
        InputFileError: None of them is there. The message names the first, as ``expected``.
        UsageError: None was given.
    """
    if not images:
        raise UsageError("expected at least one photograph")
    obstacles = []
    for path in images:
        try:
            check_regular(path, expected, LARGEST_FILE_BYTES)
        except InputFileError as error:
            obstacles.append(str(error))
    if len(obstacles) == len(images):
        more = len(obstacles) - 1
        raise InputFileError(obstacles[0] + (f"; {counted(more, 'other')} cannot be read either" if more else ""))
    for obstacle in obstacles:
        say(console, obstacle)


def for_each_face(
    images: Sequence[Path], finder: FaceFinder, console: Console, use: Callable[[SeenFace], None]
) -> Tally:
    """Finds the faces of all photographs, predicts their maps, and hands each face on.

    A photograph that cannot be read, or has no face, goes to the tally's problems and does not end the run.
    """
    tally, taken = Tally(len(images)), set[str]()
    with progress_bar(console, "photographs", len(images)) as advance:
        for stem, path in zip(_stems(images), images, strict=True):
            for face in _faces(stem, path, finder, tally, taken):
                try:
                    use(face)
                    tally.n_faces += 1
                except DegenerateGeometryError as error:
                    tally.problems.append(located(error, path))
            advance()
    return tally


def write_maps_picture(out: Path, face: SeenFace) -> None:
    """Writes ``NAME-maps.png``: crop, PNCC and offset side by side."""
    crop = crop_image(face.image, face.prediction.crop)
    write_picture(out / f"{face.name}-maps.png", draw_maps(crop, face.prediction.maps))


def write_picture(path: Path, picture: Photograph) -> None:
    """Writes a picture; unlike OpenCV's own function it takes every name and says when it fails."""
    write_file(path, cv2.imencode(path.suffix, picture[..., ::-1])[1].tobytes())


def _faces(stem: str, path: Path, finder: FaceFinder, tally: Tally, taken: set[str]) -> list[SeenFace]:
    try:
        image = read_photograph(path)
        predictions = finder.pix2face.predict(image, finder.boxes_of(path, image))
    except (InputFileError, DegenerateGeometryError) as error:
        tally.problems.append(located(error, path))
        return []
    names = [stem] if len(predictions) == 1 else [f"{stem}-{index}" for index in range(len(predictions))]
    return [
        SeenFace(_unused(name, taken), path, image, prediction, (image.shape[0], image.shape[1]))
        for name, prediction in zip(names, predictions, strict=True)
    ]


def located(error: Exception, path: Path) -> str:
    """An error's message with the photograph that it is about."""
    return str(error) if str(path) in str(error) else f"{path}: {error}"


def _stems(images: Sequence[Path]) -> list[str]:
    """The stem of each file; those that occur more than once get the number of their photograph, from 000."""
    stems = [path.stem for path in images]
    return [stem if stems.count(stem) == 1 else f"{stem}-{index:03d}" for index, stem in enumerate(stems)]


def _unused(name: str, taken: set[str]) -> str:
    """A name that no other face of this run has, so that nothing is overwritten; capitals make no difference.

    ``NAME-points`` is taken with NAME: the point cloud of the one would be the mesh of the other.
    """
    unused, number = name, 2
    while taken & _file_stems(unused):
        unused, number = f"{name}-{number}", number + 1
    taken |= _file_stems(unused)
    return unused


def _file_stems(name: str) -> set[str]:
    return {name.casefold(), f"{name}-points".casefold()}
