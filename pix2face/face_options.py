"""What every command that finds faces asks for: which network, and where the faces are."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import final

from jaxtyping import UInt8
from numpy import ndarray

from pix2face.crops import FaceBox
from pix2face.detection import detect_faces
from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.interface import Pix2Face
from pix2face.morphable_model import BUILTIN_MODEL

LARGEST_BOX_PX = 1e6


@final
@dataclass(frozen=True)
class FaceOptions:
    """Network, model and face boxes; part of the configuration of several commands."""

    checkpoint: Path | None = None
    """What training wrote; default is the last one below runs/."""
    model: str = BUILTIN_MODEL
    """``builtin`` or a model file: the one that the checkpoint was trained for."""
    device: str | None = None
    """Torch device, such as cpu or cuda; default is a GPU where there is one."""
    box: tuple[float, float, float, float] | None = None
    """Face box in pixels: left top right bottom (tight around the 68 landmarks). Without it faces are detected."""
    largest: bool = False
    """Take only the largest face of each photograph."""

    def check(self) -> None:
        """Refuses what can never work, before anything takes time.

        Raises:
            UsageError: A box of less than a pixel, or of more than a million.
        """
        if self.box is None:
            return
        left, top, right, bottom = self.box
        if not (right - left >= 1 and bottom - top >= 1 and max(abs(side) for side in self.box) <= LARGEST_BOX_PX):
            raise UsageError(f"expected --box left top right bottom, in pixels and in this order, found {self.box}")

    def only_largest(self) -> "FaceOptions":
        """The same with one face for each photograph."""
        return replace(self, largest=True)

    def open(self, *, with_model: bool = True) -> Pix2Face:
        """The network and its model.

        Args:
            with_model: Whether a model is needed; maps can do without.

        Raises:
            Pix2FaceError: As ``Pix2Face.load``.
        """
        return Pix2Face.load(self.checkpoint, self.model if with_model else None, self.device, detect_faces)

    def boxes(self, image: UInt8[ndarray, "h w 3"], pix2face: Pix2Face) -> list[FaceBox]:
        """The boxes to look at in a photograph, largest first.

        Raises:
            DegenerateGeometryError: There is none, or the one given lies beside the photograph.
        """
        if self.box is not None:
            height, width = image.shape[:2]
            left, top, right, bottom = self.box
            if not (left < width and right > 0 and top < height and bottom > 0):
                raise DegenerateGeometryError(f"--box lies beside the picture of {width} x {height} pixels")
            return [FaceBox(*self.box)]
        boxes = pix2face.find_faces(image)
        if not boxes:
            raise DegenerateGeometryError("no face found; say where it is with --box left top right bottom")
        return boxes[:1] if self.largest else boxes
