"""What every command that finds faces asks for: which network, and where the faces are."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

from jaxtyping import UInt8
from numpy import ndarray

from pix2face.api import Pix2Face
from pix2face.detectors.detection import DEFAULT_DETECTOR
from pix2face.errors import DegenerateGeometryError, ModelMismatchError, UsageError
from pix2face.face_files.box_files import LARGEST_BOX_PX, BoxFile, read_box_file
from pix2face.geometry.crops import FaceBox
from pix2face.landmark_choice.landmark_file import open_model_with
from pix2face.models.morphable_model import BUILTIN_MODEL


@final
@dataclass(frozen=True)
class FaceOptions:
    """Network, model and face boxes; part of the configuration of several commands."""

    checkpoint: Path | None = None
    """What training wrote; default is the packaged one."""
    model: str = BUILTIN_MODEL
    """``builtin`` or a model file: the one that the checkpoint was trained for."""
    landmarks: Path | None = None
    """Which vertices the landmarks are: a file of ``pix2face landmarks select``. Without it those that the checkpoint
    chooses, or else the model's own."""
    device: str | None = None
    """Torch device, such as cpu or cuda; default is a GPU where there is one."""
    box: tuple[float, float, float, float] | None = None
    """Face box in pixels: left top right bottom (tight around the 68 landmarks). Without it faces are detected."""
    boxes: Path | None = None
    """File of face boxes: CSV with a line image,left,top,right,bottom above, or JSON; without it faces are detected."""
    detector: str = DEFAULT_DETECTOR
    """What finds faces: lbp, lbp-quick (faster, finds fewer), dlib (the paper's; pip install 'pix2face[dlib]')."""
    refine: bool = True
    """Correct, confirm or refute the detector's boxes by a first prediction."""
    largest: bool = False
    """Take only the largest face of each photograph."""

    def check(self) -> None:
        """Refuses what can never work, before anything takes time.

        Raises:
            UsageError: A box of less than a pixel, or of more than a million; or boxes from two places.
        """
        if self.box is None:
            return
        if self.boxes is not None:
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
        detects = self.box is None and self.boxes is None
        model = open_model_with(self.model, self.landmarks) if needs_model or (detects and self.refine) else None
        box_file = None if self.boxes is None else read_box_file(self.boxes)
        try:
            pix2face = Pix2Face.load(
                self.checkpoint,
                model,
                self.device,
                self.detector,
                self.refine,
                own_landmarks=self.landmarks is None,
            )
        except ModelMismatchError as error:
            if needs_model:
                raise
            raise ModelMismatchError(f"{error}; or say --no-refine, which needs no model") from error
        return FaceFinder(pix2face, self.box, box_file, self.largest)


@final
@dataclass(frozen=True, eq=False)
class FaceFinder:
    """Knows where to look for faces.

    Attributes:
        pix2face: The network and what belongs to it.
        box: The box for all photographs, left, top, right, bottom in pixels, or None.
        box_file: Boxes by photograph, or None.
        largest: Whether only the largest face of a photograph counts.
    """

    pix2face: Pix2Face
    box: tuple[float, float, float, float] | None = None
    box_file: BoxFile | None = None
    largest: bool = False

    def only_largest(self) -> "FaceFinder":
        """The same with one face for each photograph."""
        return replace(self, largest=True)

    def boxes_of(self, path: Path, image: UInt8[ndarray, "h w 3"]) -> list[FaceBox]:
        """The boxes to look at in a photograph, largest first.

        Raises:
            DegenerateGeometryError: There is none, or one that was given lies beside the photograph.
        """
        boxes = self._given(path, image) or self.pix2face.find_faces(image)
        if not boxes:
            raise DegenerateGeometryError("no face found; say where it is with --box left top right bottom")
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
