"""Faces from annotated photographs: camera, identity and expression of any model, fitted to 68 points.

Points that a person set are fitted robustly, since some are guessed behind hair or a hand, and jaw points slide along
the outline. Points that are projections of a 3D model (``pt3d_68``) belong to fixed vertices and have a known depth.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy import ndarray

from datagen.faces.face_checks import check_face, check_orientation
from datagen.faces.sources import FaceSource, folder_sha256, is_text, picture_of
from pix2face.errors import DegenerateGeometryError, InputFileError, SampleRejectedError
from pix2face.face_files.annotations import AnnotatedFace, find_annotations
from pix2face.face_files.coefficients import Face
from pix2face.files.images import read_orientation, read_size_px
from pix2face.fitting.from_landmarks import LandmarkFit, LandmarkModel, fit_landmarks
from pix2face.fitting.jaw_contour import JawContour
from pix2face.geometry.believable_face import PROJECTED, SET_BY_HAND
from pix2face.geometry.crops import FaceBox
from pix2face.models.morphable_model import MorphableModel

# With a larger median residual, the points are no face or in another order. The faces that `believable_face` names stay
# below 1.8 % with the built-in model and below 5.1 % with one of 10 components.
LARGEST_RESIDUAL = 0.10
# Points of a smaller weight in the robust fit count as wrong.
DISTRUST = 0.25


@final
class AnnotatedFolder(FaceSource):
    """The annotated faces in a folder and its subfolders, to which a model is fitted.

    Annotations are ``.pts`` or ``.mat`` files beside pictures, or lists in dlib's XML.
    """

    def __init__(self, folder: Path, model: MorphableModel) -> None:
        self._fitter = AnnotatedFaceFitter.of(model)
        self._annotations = find_annotations(folder)
        self.sample_ids = tuple(annotation.name for annotation in self._annotations)
        self.sha256 = folder_sha256(
            self.sample_ids, ((each.path, each.image_path or picture_of(each.path)) for each in self._annotations)
        )
        self.licence = f"photographs and annotations: terms of their source; model: {model.licence}"

    def face(self, index: int) -> Face:
        """Fits one face."""
        annotation = self._annotations[index]
        if not is_text(annotation.name):
            raise SampleRejectedError(f"{annotation.name!r}: expected a file name in UTF-8; rename it")
        try:
            annotated = annotation.load()
            height_px, width_px = read_size_px(annotated.image_path)
            fit = self._fitter.fit(annotated)
            attributes = describe_fit(fit, annotated)
            check_orientation(fit.camera, read_orientation(annotated.image_path))
        except (InputFileError, DegenerateGeometryError) as error:
            raise SampleRejectedError(f"{annotation.name}: {error}") from error
        face = Face(
            sample_id=annotation.name,
            identity=fit.identity.astype(np.float32),
            expression=fit.expression.astype(np.float32),
            camera=fit.camera,
            height_px=height_px,
            width_px=width_px,
            image_path=annotated.image_path,
            attributes=attributes,
        )
        limits = SET_BY_HAND if annotated.follows_outline else PROJECTED
        check_face(face, self._fitter.projected, limits, annotated.landmarks2d)
        return face


@final
@dataclass(frozen=True, eq=False)
class AnnotatedFaceFitter:
    """Fits a model to annotations, robustly where a person set the points."""

    projected: LandmarkModel  # for points that are projections of a model
    marked: LandmarkModel  # for points that a person set
    contour: JawContour

    @classmethod
    def of(cls, model: MorphableModel) -> "AnnotatedFaceFitter":
        """Takes the landmarks of a model."""
        return cls(LandmarkModel.of(model), LandmarkModel.marked(model), JawContour.of(model))

    def fit(self, annotated: AnnotatedFace) -> LandmarkFit:
        """Fits one face.

        Raises:
            DegenerateGeometryError: The points do not determine a face, or are not those of a face.
        """
        by_hand = annotated.follows_outline
        fit = fit_landmarks(
            self.marked if by_hand else self.projected,
            annotated.landmarks2d,
            depths_px=annotated.depths_px,
            robust=by_hand,
            contour=self.contour if by_hand else None,
        )
        residual = relative_residual(fit, annotated, np.median)
        if not residual <= LARGEST_RESIDUAL:
            raise DegenerateGeometryError(
                f"expected points of a face, found a median residual of {100 * residual:.0f} % of the face box: "
                "are they 68 iBUG points in their order?"
            )
        return fit


def relative_residual(fit: LandmarkFit, annotated: AnnotatedFace, summary: Callable[[ndarray], Any] = np.mean) -> float:
    """Mean (or another summary) of the distances between given and matched points, over sqrt(w h) of their box."""
    box = FaceBox.around(annotated.landmarks2d)
    present = np.isfinite(annotated.landmarks2d).all(axis=1)
    distances = np.linalg.norm((fit.matched2d - annotated.landmarks2d)[present], axis=1)
    return float(summary(distances)) / float(np.sqrt(box.width * box.height))


def describe_fit(fit: LandmarkFit, annotated: AnnotatedFace) -> dict[str, str | float]:
    """The attributes of a fitted face."""
    way = "annotated points, jaw along the outline" if annotated.follows_outline else "pt3d_68"
    return {
        "geometry": f"fitted to {way}",
        "residual_percent": round(100 * relative_residual(fit, annotated), 3),
        "distrusted_points": int((fit.trust < DISTRUST).sum()),
    }
