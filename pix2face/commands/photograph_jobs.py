"""What the commands for photographs share: reading photographs, finding and naming their faces, and reporting."""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from rich.console import Console

from pix2face.command_line import EXIT_REJECTED, progress_bar, say
from pix2face.commands.face_finder import FaceFinder
from pix2face.errors import DegenerateGeometryError, InputFileError
from pix2face.files.images import read_photograph, write_picture
from pix2face.fitting.face_fit import FaceFit
from pix2face.inference.predictor import Prediction
from pix2face.photographs.fit_pictures import draw_maps
from pix2face.photographs.refined_detection import PLAUSIBLE_ERROR

Photograph = UInt8[ndarray, "h w 3"]


@final
@dataclass(frozen=True, eq=False)
class SeenFace:
    """A face in a photograph, with its predicted maps."""

    name: str  # name of its files: that of the photograph and a number from 0, by decreasing size
    path: Path  # file of the photograph
    image: Photograph
    prediction: Prediction
    size_px: tuple[int, int]  # height and width of the photograph

    def without_image(self) -> "SeenFace":
        """Returns the face without its photograph, to save memory."""
        return replace(self, image=np.zeros((0, 0, 3), dtype=np.uint8))

    def with_image(self) -> "SeenFace":
        """Returns the face with its photograph, which is read again.

        Raises:
            InputFileError: The photograph cannot be read, or its size has changed.
        """
        image = read_photograph(self.path)
        if image.shape[:2] != self.size_px:
            raise InputFileError(f"{self.path}: the photograph changed while it was worked on; run again")
        return replace(self, image=image)


@final
@dataclass(frozen=True, eq=False)
class SeenPhotograph:
    """A photograph and its faces, largest first."""

    name: str  # name of its results
    path: Path
    faces: Sequence[SeenFace]


@final
@dataclass(eq=False)
class Tally:
    """Counts the photographs, faces and problems of a run."""

    n_photographs: int = 0
    n_faces: int = 0
    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    @contextmanager
    def face(self, path: Path) -> Iterator[None]:
        """Counts a face when the block ends, or adds a problem if the block raises a DegenerateGeometryError."""
        try:
            yield
            self.n_faces += 1
        except DegenerateGeometryError as error:
            self.problems.append(located(error, path))

    def check_plausible(self, fitted: FaceFit, face: SeenFace) -> None:
        """Adds a warning if the network expects a large error, as in a box without a face."""
        error = fitted.expected_error
        if error is not None and error > PLAUSIBLE_ERROR:
            self.warnings.append(
                f"warning: {face.path}: {face.name}: the network expects an error of {100 * error:.0f} % of the face's "
                "size; is there a face in its box?"
            )

    def report(self, console: Console, where: Path) -> int:
        """Prints problems, warnings and counts, and returns the exit status."""
        for line in (*self.problems, *self.warnings):
            say(console, line)
        say(console, f"photographs: {self.n_photographs}, faces: {self.n_faces} -> {where}")
        return EXIT_REJECTED if self.problems else 0


def look_at(images: Sequence[Path], finder: FaceFinder, console: Console, tally: Tally) -> Iterator[SeenPhotograph]:
    """Reads photographs one by one, finds their faces and predicts their maps.

    A photograph that cannot be read, or has no face, is added to the problems of the tally. The former is left out, and
    the latter is yielded without faces.
    """
    tally.n_photographs = len(images)
    with progress_bar(console, "photographs", len(images)) as advance:
        for name, path in zip(photograph_names(images), images, strict=True):
            try:
                image = read_photograph(path)
            except InputFileError as error:
                tally.problems.append(located(error, path))
            else:
                yield SeenPhotograph(name, path, _faces(name, path, image, finder, tally))
            advance()


def write_maps_picture(out: Path, face: SeenFace) -> None:
    """Writes ``NAME-maps.png``: crop, PNCC and offset side by side."""
    write_picture(out / f"{face.name}-maps.png", draw_maps(face.image, face.prediction.crop, face.prediction.maps))


def _faces(name: str, path: Path, image: Photograph, finder: FaceFinder, tally: Tally) -> list[SeenFace]:
    try:
        predictions = finder.pix2face.predict(image, finder.boxes_of(path, image))
    except DegenerateGeometryError as error:
        tally.problems.append(located(error, path))
        return []
    size_px = (image.shape[0], image.shape[1])
    return [SeenFace(f"{name}-{index}", path, image, own, size_px) for index, own in enumerate(predictions)]


def located(error: Exception, path: Path) -> str:
    """Returns an error's message, with the photograph's path in it."""
    return str(error) if str(path) in str(error) else f"{path}: {error}"


def photograph_names(images: Sequence[Path]) -> list[str]:
    """Returns the name of each photograph's results: its file name without suffix.

    If several have the same name (case is ignored), the second is called NAME.2, the third NAME.3, and so on.
    """
    stems = {path.stem.casefold() for path in images}
    taken, numbers = set[str](), Counter[str]()
    names = []
    for path in images:
        name = path.stem
        while name.casefold() in taken or (name != path.stem and name.casefold() in stems):
            numbers[path.stem.casefold()] += 1
            name = f"{path.stem}.{numbers[path.stem.casefold()] + 1}"
        taken.add(name.casefold())
        names.append(name)
    return names
