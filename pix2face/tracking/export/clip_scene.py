"""A tracked face as a scene with a fixed camera, a moving head, and its expression in each frame.

The scene is in metres: x right, y up, z towards the viewer. The camera is at the origin and looks along -z, as in glTF
and USD, so a head that looks at the camera is not rotated.

Without perspective, distance and size are ambiguous. The head is then 1 m away, and its size is proportional to the
scale of the fit. It is life-size at the median scale of the clip.
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
    """The pose of the head in each frame, and the lens of the camera."""

    rotations: Float64[ndarray, "n 3 3"]  # scene from model
    translations_m: Float64[ndarray, "n 3"]
    scales: Float64[ndarray, " n"]  # of the head; 1 with perspective
    width_m: float | None = None  # width of the picture in the scene; None with perspective
    focal_px: Float64[ndarray, " n"] | None = None  # None without perspective

    @property
    def quaternions(self) -> Float64[ndarray, "n 4"]:
        """The rotations as (x, y, z, w), with signs that make interpolation between frames take the short way."""
        quaternions = Rotation.from_matrix(self.rotations).as_quat()
        turns = np.einsum("ni,ni->n", quaternions[1:], quaternions[:-1])
        quaternions[1:] *= np.cumprod(np.where(turns < 0, -1.0, 1.0))[:, None]
        return np.asarray(quaternions)


@final
@dataclass(eq=False)
class ClipScene:
    """The frames of one face of a clip, at less than a kilobyte per frame.

    Attributes:
        model: The morphable model.
        identity: Identity coefficients in standard deviations.
        size_px: Height and width of the frames.
        fps: Mean number of frames per second.
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
        """Appends a frame; ``fit`` is None if it does not show the face."""
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
        """The expression of each frame in standard deviations; frames without the face have that of the one before."""
        return np.array(self._expressions)[self._shown]

    def neutral_vertices(self) -> Float32[ndarray, "v 3"]:
        """Returns the vertices of the neutral face in mm, model frame."""
        return self.model.vertices(self.identity[None], np.zeros((1, self.model.n_expression)))[0]

    def motion(self) -> HeadMotion:
        """Returns the motion of the head relative to the fixed camera. It does not move in frames without the face.

        The principal point is moved to the middle of the picture, and the head is shifted so that its origin is seen at
        the same place.
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
        """Index, among the frames with a face, of the last one up to each frame; that of the first before it."""
        return np.maximum(np.cumsum(self.is_there) - 1, 0)

    @property
    def _middle_px(self) -> Float64[ndarray, "2"]:
        return np.array([self.size_px[1] / 2, self.size_px[0] / 2])
