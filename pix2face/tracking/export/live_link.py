"""Writes the blendshape weights of a tracked face in the CSV format of the app Live Link Face.

Rotations are in radians about the axes of the model frame, which are those of ARKit's face anchor: pitch about x
(positive looks down), yaw about y (positive turns to the subject's left), roll about z (positive tilts the crown to the
subject's right), applied as roll, yaw, pitch. Rotations of the eyes are relative to the head.
"""

import csv
from io import TextIOBase
from typing import Final, final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from pix2face.errors import DegenerateGeometryError
from pix2face.files.writing import GrowingFile
from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.camera import FRONTAL, nearest_weak_perspective
from pix2face.geometry.rigid_alignment import fit_rigid
from pix2face.models.morphable_model import MorphableModel
from pix2face.tracking.export.blendshapes import ARKIT_NAMES, LEFT, RIGHT, BlendshapeSolver

ROTATIONS: Final = tuple(part + angle for part in ("Head", "LeftEye", "RightEye") for angle in ("Yaw", "Pitch", "Roll"))
COLUMNS: Final = ("Timecode", "BlendShapeCount", *(name[0].upper() + name[1:] for name in ARKIT_NAMES), *ROTATIONS)
EYE_REGIONS: Final = ("eyes", "iris", "pupil")


@final
class LiveLinkFile:
    """Writes a file frame by frame.

    Args:
        file: File open for writing text.
        model: Model with ARKit's expressions.
        fps: Frames per second, rounded to an integer for time codes.

    Raises:
        UsageError: The model lacks an expression.
    """

    def __init__(self, file: TextIOBase | GrowingFile, model: MorphableModel, fps: float) -> None:
        self._rows = csv.writer(file, lineterminator="\n")
        self._rows.writerow(COLUMNS)
        self._solver = BlendshapeSolver(model)
        self._eyes = [_Eye(model, side) for side in (LEFT, RIGHT)]
        self._rate = max(round(fps), 1)

    def write(self, frame: int, fit: FaceFit | None) -> None:
        """Appends a frame. A frame without a face has a count of 0 and empty cells."""
        time_code = _time_code(frame, self._rate)
        if fit is None:
            self._rows.writerow([time_code, 0, *[""] * (len(COLUMNS) - 2)])
            return
        head = FRONTAL @ nearest_weak_perspective(fit.camera).rotation
        turns = [head, *(eye.rotation(fit.expression) for eye in self._eyes)]
        # R = Rx(pitch) Ry(yaw) Rz(roll); the file has yaw first.
        angles = Rotation.from_matrix(np.array(turns)).as_euler("XYZ")[:, [1, 0, 2]]
        values = [*self._solver.weights(fit.expression), *angles.ravel()]
        self._rows.writerow([time_code, len(values), *(f"{value:.6f}" for value in values)])


@final
class _Eye:
    """The eyeball of one side, which expressions rotate."""

    def __init__(self, model: MorphableModel, side: str) -> None:
        vertices = model.vertices_of(*EYE_REGIONS)
        sign = 1 if side == LEFT else -1
        own = vertices[model.mean[vertices, 0] * sign > 0]
        self._points = model.mean[own].astype(np.float64)
        self._basis = model.expression_basis[:, own].reshape(model.n_expression, 3 * len(own))

    def rotation(self, expression: ndarray) -> Float64[ndarray, "3 3"]:
        moved = self._points + (expression @ self._basis).reshape(-1, 3)
        try:
            return fit_rigid(self._points, moved)[0].rotation
        except DegenerateGeometryError:  # a model without eyeballs
            return np.eye(3)


def _time_code(frame: int, rate: int) -> str:
    """Returns hours, minutes, seconds and frames; the part after the point is the fraction of a frame."""
    seconds, rest = divmod(frame, rate)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}:{rest:02d}.000"
