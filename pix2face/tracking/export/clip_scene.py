"""A tracked face as a scene: a camera that stands still, a head that moves, and its expression in each frame.

The scene is in metres: x right, y up, z towards the viewer. The camera stands at the origin and looks along -z, as in
glTF and USD, so a head that looks at the camera is not turned.

A camera without perspective cannot tell distance from size. The head is then 1 m away, and its size varies with the
scale of the fit; it is life-size where the scale is the median of the clip.
"""

from dataclasses import dataclass, field
from typing import final

import numpy as np
from jaxtyping import Float32, Float64, Int64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.camera import FRONTAL, Camera, Pinhole, nearest_weak_perspective, pinhole_of
from pix2face.geometry.other_cameras import M_PER_MM, ORTHOGRAPHIC_DISTANCE_MM, far_pinhole
from pix2face.models.morphable_model import MorphableModel


@final
@dataclass(frozen=True, eq=False)
class HeadMotion:
    """Where the head is in each frame, and the lens of the camera."""

    rotations: Float64[ndarray, "n 3 3"]  # scene from model
    translations_m: Float64[ndarray, "n 3"]
    scales: Float64[ndarray, " n"]  # of the head; 1 with perspective
    width_m: float | None = None  # what the picture shows from side to side, without perspective; None with it
    focal_px: Float64[ndarray, " n"] | None = None  # with perspective

    @property
    def quaternions(self) -> Float64[ndarray, "n 4"]:
        """The rotations as (x, y, z, w), each next to the one before, so that every program turns the short way."""
        quaternions = Rotation.from_matrix(self.rotations).as_quat()
        turns = np.einsum("ni,ni->n", quaternions[1:], quaternions[:-1])
        quaternions[1:] *= np.cumprod(np.where(turns < 0, -1.0, 1.0))[:, None]
        return np.asarray(quaternions)


@final
@dataclass(eq=False)
class ClipScene:
    """The frames of one face of a clip. Keeps less than a kilobyte a frame.

    Attributes:
        model: The morphable model.
        identity: Of the face, standard deviations.
        size_px: Height and width of the frames.
        fps: Frames a second, the mean.
    """

    model: MorphableModel
    identity: Float64[ndarray, " k"]
    size_px: tuple[int, int]
    fps: float
    frames: list[int] = field(default_factory=list)
    times_s: list[float] = field(default_factory=list)  # from the first frame of the clip
    is_there: list[bool] = field(default_factory=list)  # whether the frame shows the face
    _cameras: list[Camera] = field(default_factory=list)  # of the frames that show the face
    _expressions: list[Float32[ndarray, " e"]] = field(default_factory=list)

    def add(self, frame: int, time_s: float, fit: FaceFit | None) -> None:
        """Appends a frame; None if it does not show the face."""
        self.frames.append(frame)
        self.times_s.append(time_s)
        self.is_there.append(fit is not None)
        if fit is not None:
            self._cameras.append(fit.camera)
            self._expressions.append(fit.expression.astype(np.float32))

    @property
    def shows_face(self) -> bool:
        """Whether any frame shows the face."""
        return any(self.is_there)

    @property
    def expressions(self) -> Float32[ndarray, "n e"]:
        """The expression of each frame in standard deviations; that of the frame before where there is no face."""
        return np.array(self._expressions)[self._shown]

    def neutral_vertices(self) -> Float32[ndarray, "v 3"]:
        """The face without an expression: mm, model frame."""
        return self.model.vertices(self.identity[None], np.zeros((1, self.model.n_expression)))[0]

    def motion(self) -> HeadMotion:
        """The head's motion before the camera that stands still. It rests in frames without the face.

        A camera whose axis does not meet the middle of the picture is turned into one whose axis does: the head is
        shifted so that its origin is seen at the same place.
        """
        if all(camera.is_affine for camera in self._cameras):
            return self._without_perspective()
        return self._with_perspective()

    def _without_perspective(self) -> HeadMotion:
        weak = [nearest_weak_perspective(camera) for camera in self._cameras]
        scales = np.array([own.scale for own in weak])
        px_per_mm = float(np.median(scales))
        places = (np.array([own.translation_px for own in weak]) - self._middle_px) / px_per_mm
        depths = np.full((len(weak), 1), ORTHOGRAPHIC_DISTANCE_MM)
        return HeadMotion(
            FRONTAL @ np.array([own.rotation for own in weak])[self._shown],
            (np.hstack([places, depths]) @ FRONTAL * M_PER_MM)[self._shown],
            (scales / px_per_mm)[self._shown],
            width_m=self.size_px[1] / px_per_mm * M_PER_MM,
        )

    def _with_perspective(self) -> HeadMotion:
        pinholes = [
            far_pinhole(nearest_weak_perspective(camera)) if camera.is_affine else pinhole_of(camera)
            for camera in self._cameras
        ]
        return HeadMotion(
            FRONTAL @ np.array([own.rotation for own in pinholes])[self._shown],
            (np.array([self._place_mm(own) for own in pinholes]) @ FRONTAL * M_PER_MM)[self._shown],
            np.ones(len(self.frames)),
            focal_px=np.array([own.focal_px for own in pinholes])[self._shown],
        )

    def _place_mm(self, pinhole: Pinhole) -> Float64[ndarray, "3"]:
        shift = (pinhole.principal_point_px - self._middle_px) / pinhole.focal_px * pinhole.translation_mm[2]
        return pinhole.translation_mm + np.append(shift, 0)

    @property
    def _shown(self) -> Int64[ndarray, " n"]:
        """For each frame the place, among those with a face, of itself or the last one before; at first, the first."""
        return np.maximum(np.cumsum(self.is_there) - 1, 0)

    @property
    def _middle_px(self) -> Float64[ndarray, "2"]:
        return np.array([self.size_px[1] / 2, self.size_px[0] / 2])
