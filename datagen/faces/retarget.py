"""Fits a model to the landmarks that come with files of 300W-LP and AFLW2000-3D.

The coefficients of the files belong to BFM 2009 and mean nothing to another model, but their landmarks mean the same to
all. The first of these that a file has is used:

1. ``pt3d_68`` in the file (AFLW2000-3D): all 68 model points in this very picture.
2. ``landmarks/<folder>/NAME_pts.mat`` (300W-LP as distributed): ``pts_3d`` of this very copy.
3. ``pt2d`` of the file itself, where it is the copy ``_0``: the points of the photograph that it profiles.
4. ``pt2d`` of the sibling ``_0``: identity and expression from there, the pose from the file's own ``Pose_Para``.
"""

import re
from functools import lru_cache
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError, InputFileError, SampleRejectedError
from pix2face.face_files.annotations import picture_beside
from pix2face.face_files.w300lp import CoefficientFile, camera_of_pose, read_coefficient_file, read_landmark_file
from pix2face.files.images import read_size_px
from pix2face.files.opening import is_regular
from pix2face.fitting.from_landmarks import LandmarkFit, LandmarkModel, fit_landmarks
from pix2face.geometry.camera import Camera, WeakPerspective, nearest_weak_perspective, weak_perspective_camera
from pix2face.models.morphable_model import MorphableModel

COPY_NUMBER = re.compile(r"_(\d+)$")

Geometry = tuple[Float64[ndarray, " k"], Float64[ndarray, " e"], Camera, str]


@final
class Retargeter:
    """Fits one model to the files of one folder of a data set; ``landmarks/`` is searched there and above."""

    def __init__(self, model: MorphableModel, folder: Path) -> None:
        self._model = LandmarkModel.of(model)
        self._folder = folder
        # The copies of one photograph follow each other, so their common fit is made once.
        self._sibling_fit = lru_cache(maxsize=4)(self._fit_sibling)

    def fit(self, file: CoefficientFile, image_height_px: int) -> Geometry:
        """Fits one file. The text says what was fitted to.

        Raises:
            SampleRejectedError: The file has no landmarks of its picture, or they do not determine a face.
        """
        try:
            return self._fit(file, image_height_px)
        except (InputFileError, DegenerateGeometryError) as error:
            raise SampleRejectedError(f"{file.path}: cannot be retargeted: {error}") from error

    def _fit(self, file: CoefficientFile, image_height_px: int) -> Geometry:
        copy = COPY_NUMBER.search(file.path.stem)
        if file.landmarks3d is not None:
            found = fit_landmarks(self._model, file.landmarks3d[:, :2], depths_px=file.landmarks3d[:, 2])
            method = "fitted to pt3d_68"
        elif (landmark_path := self.landmark_path(file.path)) is not None:
            found = fit_landmarks(self._model, read_landmark_file(landmark_path))
            method = "fitted to the landmarks folder"
        elif copy is None or int(copy[1]) == 0:
            found, method = self._fit_own(file), "fitted to pt2d"
        else:
            sibling = file.path.with_name(file.path.stem[: copy.start()] + "_0.mat")
            return self._fit_copy(file, sibling, image_height_px)
        return found.identity, found.expression, found.camera, method

    def _fit_own(self, file: CoefficientFile) -> LandmarkFit:
        if file.landmarks2d is None:
            raise InputFileError("expected pt3d_68, a landmarks folder, or pt2d with 68 points, found none of them")
        return fit_landmarks(self._model, file.landmarks2d)

    def _fit_copy(self, file: CoefficientFile, sibling: Path, image_height_px: int) -> Geometry:
        if not is_regular(sibling):
            raise InputFileError(
                f"its pt2d belongs to the source photograph, and neither a landmarks folder nor {sibling.name} is there"
            )
        fit, bfm_from_model = self._sibling_fit(sibling)
        camera = nearest_weak_perspective(camera_of_pose(file.pose, image_height_px))
        # From the model's frame to BFM's, and from there to the picture of this copy.
        matrix = camera.scale * camera.rotation @ bfm_from_model[:, :3]
        translation = camera.translation_px + (camera.scale * camera.rotation @ bfm_from_model[:, 3])[:2]
        scale = float(np.cbrt(np.linalg.det(matrix)))
        posed = weak_perspective_camera(WeakPerspective(scale, matrix / scale, translation))
        return fit.identity, fit.expression, posed, f"fitted to pt2d of {sibling.stem}, posed by the file"

    def _fit_sibling(self, path: Path) -> tuple[LandmarkFit, Float64[ndarray, "3 4"]]:
        """The fit of a copy ``_0``, and the similarity from the model's frame to BFM's that its pose implies.

        The fitted camera maps the model's frame to the picture, and the file's camera maps BFM's frame to it. Scale and
        rotation between the frames follow. The picture does not show the translation along the viewing direction; it
        is taken as 0, which is right as far as both origins lie at the same place in the head.
        """
        file = read_coefficient_file(path)
        fit = self._fit_own(file)
        image_height, _ = read_size_px(picture_beside(path))
        seen = nearest_weak_perspective(fit.camera)
        stated = nearest_weak_perspective(camera_of_pose(file.pose, image_height))
        rotation = seen.scale / stated.scale * stated.rotation.T @ seen.rotation
        across = np.append((seen.translation_px - stated.translation_px) / stated.scale, 0)
        return fit, np.column_stack([rotation, stated.rotation.T @ across])

    def landmark_path(self, path: Path) -> Path | None:
        """Finds ``landmarks/<folder>/NAME_pts.mat`` of a file, from its folder upward."""
        name = f"{path.stem}_pts.mat"
        for root in path.parents:
            candidate = root / "landmarks" / path.parent.relative_to(root) / name
            if is_regular(candidate):
                return candidate
            if root == self._folder.parent:
                break
        return None
