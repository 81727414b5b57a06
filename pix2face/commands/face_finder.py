"""Opens the network, the model and the face boxes that the options of a command name."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import final

from jaxtyping import UInt8
from numpy import ndarray

from pix2face.api import Pix2Face
from pix2face.commands.pix2face_config import PhotographOptions
from pix2face.detectors.protocol import Box
from pix2face.errors import DegenerateGeometryError, ModelMismatchError
from pix2face.face_files.box_files import BoxFile, read_box_file
from pix2face.geometry.crops import FaceBox
from pix2face.landmark_choice.landmark_file import open_model_with

NO_FACE = (
    "no face found; say where the face is with --box left top right bottom, look for smaller faces with "
    "--smallest-face (0.02 or less), or accept doubtful faces with --min-score 0.5"
)


def open_finder(options: PhotographOptions, *, needs_model: bool = True) -> "FaceFinder":
    """Opens network, model and boxes.

    Args:
        options: The options of the command.
        needs_model: Whether the model is needed for more than correcting the detector's boxes.

    Raises:
        Pix2FaceError: As ``Pix2Face.load`` and ``read_box_file``.
    """
    faces, network = options.faces, options.faces.network
    detects = options.box is None and faces.boxes is None
    box_file = None if faces.boxes is None else read_box_file(faces.boxes)
    wants_model = needs_model or (detects and faces.refine)
    model = open_model_with(network.model, network.landmarks) if wants_model else None
    try:
        pix2face = Pix2Face.load(
            network.checkpoint,
            model,
            network.device,
            faces.detector,
            faces.refine,
            own_landmarks=network.landmarks is None,
            min_score=faces.min_score,
            smallest_face=faces.smallest_face,
        )
    except ModelMismatchError as error:
        if needs_model:
            raise
        raise ModelMismatchError(f"{error}; or say --no-refine, which needs no model") from error
    return FaceFinder(pix2face, options.box, box_file, options.largest)


@final
@dataclass(frozen=True, eq=False)
class FaceFinder:
    """Finds the boxes of faces: given ones, or else those of the detector."""

    pix2face: Pix2Face
    box: tuple[float, float, float, float] | None = None  # for all photographs: left, top, right, bottom in pixels
    box_file: BoxFile | None = None  # boxes by photograph
    largest: bool = False  # whether only the largest face of each photograph is used

    def boxes_of(self, path: Path, image: UInt8[ndarray, "h w 3"]) -> Sequence[Box]:
        """Returns the face boxes of a photograph; detected ones are sorted by size, largest first.

        Raises:
            DegenerateGeometryError: There is no face, or a given box lies outside the photograph.
        """
        boxes: Sequence[Box] = self._given(path, image)
        if not boxes:
            boxes = self.pix2face.find_faces(image)
        if not boxes:
            raise DegenerateGeometryError(NO_FACE)
        return boxes[:1] if self.largest else boxes

    def _given(self, path: Path, image: UInt8[ndarray, "h w 3"]) -> list[FaceBox]:
        if self.box is not None:
            boxes, source = [FaceBox(*self.box)], "--box"
        elif self.box_file is not None:
            boxes, source = list(self.box_file.of_image(path)), f"a box of {self.box_file.path}"
            if not boxes:
                raise DegenerateGeometryError(f"no box in {self.box_file.path}; add a line for this photograph")
        else:
            return []
        height, width = image.shape[:2]
        for box in boxes:
            if not (box.left < width and box.right > 0 and box.top < height and box.bottom > 0):
                raise DegenerateGeometryError(f"{source} lies beside the picture of {width} x {height} pixels")
        return boxes
