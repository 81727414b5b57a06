"""What every command asks for that reads faces: which network and model, and where the faces are."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, final

import tyro
from jaxtyping import UInt8
from numpy import ndarray

from pix2face.api import Pix2Face
from pix2face.command_line import optional
from pix2face.detectors.detection import DEFAULT_DETECTOR
from pix2face.detectors.protocol import SURE_SCORE, Box
from pix2face.errors import DegenerateGeometryError, ModelMismatchError, UsageError
from pix2face.face_files.box_files import LARGEST_BOX_PX, BoxFile, read_box_file
from pix2face.geometry.crops import FaceBox
from pix2face.inference import PACKAGED
from pix2face.inference.predictor import Predictor
from pix2face.landmark_choice.landmark_file import open_model_with, with_own_landmarks
from pix2face.models.morphable_model import BUILTIN_MODEL, MorphableModel

NO_FACE = (
    "no face found; is the picture turned? Detectors find upright faces: turn it, say where the face is with "
    "--box left top right bottom, look for small faces with --smallest-face 0.02, or accept doubtful faces with "
    "--min-score 0.5"
)


@final
@dataclass(frozen=True)
class NetworkOptions:
    """Which network, and the morphable model that it was trained for.

    Attributes:
        checkpoint: Checkpoint that `train` wrote. Default: the one that comes with the package.
        model: `builtin`, or the model file that the checkpoint was trained for.
        landmarks: File from `pix2face landmarks select` that lists the vertices of the landmarks. Default: the
            landmarks in the checkpoint. If it has none, and for renders, those of the model.
        device: Torch device, such as cpu or cuda. Default: a GPU if there is one.
    """

    checkpoint: Annotated[Path | None, optional("PATH")] = None
    model: str = BUILTIN_MODEL
    landmarks: Annotated[Path | None, optional("PATH")] = None
    device: Annotated[str | None, optional("STR")] = None

    @property
    def path(self) -> Path:
        """The checkpoint, named or packaged."""
        return self.checkpoint or PACKAGED

    def open_model(self) -> MorphableModel:
        """Opens the model, with the landmarks of the file if one is named.

        Raises:
            Pix2FaceError: As ``open_model_with``.
        """
        return open_model_with(self.model, self.landmarks)

    def open_predictor(self) -> Predictor:
        """Opens the network.

        Raises:
            Pix2FaceError: As ``Predictor.load``.
        """
        return Predictor.load(self.path, self.device)

    def with_chosen_landmarks(self, model: MorphableModel, predictor: Predictor) -> MorphableModel:
        """The model with the landmarks of the checkpoint, unless a file was named.

        Raises:
            ModelMismatchError: The checkpoint was trained for another model.
        """
        predictor.header.check_model(model.name, model.sha256)
        return with_own_landmarks(model, predictor.header) if self.landmarks is None else model


@final
@dataclass(frozen=True)
class FaceOptions:
    """Which network, and where the faces are.

    Attributes:
        network: Network and model.
        boxes: File of face boxes to use instead of a detector: JSON, or CSV with the header
            image,left,top,right,bottom. For videos, the first column is frame, counted from 0, as in boxes.csv, which
            is written by `pix2face track`.
        detector: Detector that finds faces: cnn (the network that comes with the package) or dlib (as in the paper;
            pip install 'pix2face[dlib]').
        min_score: Smallest score of a detected face. The higher the score, the surer the detector.
        smallest_face: Longer side of the smallest faces to find, as a share of the longer side of the picture. Smaller
            shares take longer. Default: about 0.04 for cnn and 0.08 for dlib.
        refine: Correct each box by a first prediction. In photographs, boxes in which it finds no face are rejected.
    """

    network: Annotated[NetworkOptions, tyro.conf.arg(name="")] = NetworkOptions()
    boxes: Annotated[Path | None, optional("PATH")] = None
    detector: str = DEFAULT_DETECTOR
    min_score: float = SURE_SCORE
    smallest_face: Annotated[float | None, optional("FLOAT")] = None
    refine: bool = True


@final
@dataclass(frozen=True)
class PhotographOptions:
    """Which network, and where the faces of photographs are.

    Attributes:
        faces: Network, boxes and detector.
        box: Face box in pixels, tight around the 68 landmarks, to use instead of a detector.
        largest: Take only the largest face of each photograph.
    """

    faces: Annotated[FaceOptions, tyro.conf.arg(name="")] = FaceOptions()
    box: Annotated[tuple[float, float, float, float] | None, optional("LEFT TOP RIGHT BOTTOM")] = None
    largest: bool = False

    def check(self) -> None:
        """Refuses what can never work, before anything takes time.

        Raises:
            UsageError: A box of less than a pixel, or of more than a million; or boxes from two places.
        """
        if self.box is None:
            return
        if self.faces.boxes is not None:
            raise UsageError("expected --box or --boxes, found both")
        left, top, right, bottom = self.box
        if not (right - left >= 1 and bottom - top >= 1 and max(abs(side) for side in self.box) <= LARGEST_BOX_PX):
            raise UsageError(f"expected --box left top right bottom, in pixels and in this order, found {self.box}")

    def open(self, *, needs_model: bool = True) -> "FaceFinder":
        """Opens network, model and boxes.

        Args:
            needs_model: Whether the model is needed for more than refining the detector's boxes.

        Raises:
            Pix2FaceError: As ``Pix2Face.load`` and ``read_box_file``.
        """
        faces, network = self.faces, self.faces.network
        detects = self.box is None and faces.boxes is None
        box_file = None if faces.boxes is None else read_box_file(faces.boxes)
        model = network.open_model() if needs_model or (detects and faces.refine) else None
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
        return FaceFinder(pix2face, self.box, box_file, self.largest)


@final
@dataclass(frozen=True, eq=False)
class FaceFinder:
    """Knows where to look for faces."""

    pix2face: Pix2Face
    box: tuple[float, float, float, float] | None = None  # for all photographs: left, top, right, bottom in pixels
    box_file: BoxFile | None = None  # boxes by photograph
    largest: bool = False  # whether only the largest face of a photograph counts

    def only_largest(self) -> "FaceFinder":
        """Returns a finder that takes the largest face of each photograph."""
        return replace(self, largest=True)

    def boxes_of(self, path: Path, image: UInt8[ndarray, "h w 3"]) -> Sequence[Box]:
        """Where to look in a photograph, the largest face first.

        Raises:
            DegenerateGeometryError: There is none, or one that was given lies beside the photograph.
        """
        boxes: Sequence[Box] = self._given(path, image) or self.pix2face.find_faces(image)
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
