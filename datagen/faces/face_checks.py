"""Refuses faces that cannot be those of their photographs, and names the likely cause."""

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError, SampleRejectedError
from pix2face.face_files.coefficients import Face
from pix2face.files.picture_head import UPRIGHT
from pix2face.fitting.from_landmarks import LandmarkModel, fit_mean_to_landmarks
from pix2face.geometry.believable_face import FaceLimits, facing_deg, measure_face
from pix2face.geometry.camera import Camera, nearest_weak_perspective
from pix2face.geometry.landmarks import IBUG68, MIRROR_IBUG68
from pix2face.models.morphable_model import MorphableModel

# A head that is turned farther within the picture lies on its side or stands on its crown.
UPRIGHT_WITHIN_DEG = 45.0
IN_OTHER_ORDER = "are they the 68 points of iBUG in their order, and are missing points marked with -1 or NaN?"


def landmark_model_of(model: MorphableModel) -> LandmarkModel | None:
    """The model at its landmarks; None where it has none."""
    return LandmarkModel.of(model) if IBUG68 in model.landmarks else None


def check_face(
    face: Face, model: LandmarkModel | None, limits: FaceLimits, points2d: Float64[ndarray, "68 2"] | None = None
) -> None:
    """Checks a face against what faces of photographs can be.

    The model tells the places of its landmarks; None leaves them out. From the points that it was fitted to, the likely
    cause of an error is found.

    Raises:
        SampleRejectedError: It goes farther.
    """
    coefficients = np.concatenate([face.identity, face.expression]).astype(np.float64)
    landmarks2d = np.zeros((0, 2)) if model is None else face.camera.project(model.landmarks3d(coefficients))
    measures = measure_face(face.camera, coefficients, landmarks2d, (face.height_px, face.width_px))
    problems = measures.problems(limits)
    if problems:
        if points2d is not None and model is not None:
            cause = likely_cause(model, points2d)
        else:
            cause = "were its landmarks in another order, or was the picture resized after annotation?"
        raise SampleRejectedError(
            f"{face.sample_id}: expected a face that its photograph can show, found that {'; '.join(problems)}; {cause}"
        )


def likely_cause(model: LandmarkModel, points2d: Float64[ndarray, "68 2"]) -> str:
    """Why points do not make a face, as a question.

    Points that were mirrored in any way show the mean face from behind. Of the ways to undo that, one makes it upright.
    """
    if not _faces_away(model, points2d):
        return IN_OTHER_ORDER
    ways = {
        "are they in the order of a mirrored picture (left and right exchanged)?": points2d[list(MIRROR_IBUG68)],
        "does y grow upwards in their file?": points2d * [1, -1],
        "are x and y swapped?": points2d[:, ::-1].copy(),
    }
    for question, points in ways.items():
        camera = fit_mean_to_landmarks(model, points, robust=True)
        if abs(tilt_deg(camera)) < UPRIGHT_WITHIN_DEG:
            return question
    return IN_OTHER_ORDER


def check_orientation(camera: Camera, orientation: int) -> None:
    """Checks that a face does not lie in a picture whose orientation tag makes it upright.

    Raises:
        DegenerateGeometryError: It does, so the points seem to refer to the stored pixels.
    """
    if orientation != UPRIGHT and abs(tilt_deg(camera)) > UPRIGHT_WITHIN_DEG:
        raise DegenerateGeometryError(
            f"expected an upright head, since the picture has the orientation tag {orientation}, found one that is "
            f"tilted by {tilt_deg(camera):.0f}°; points must refer to the upright picture that viewers show: do these "
            "refer to the stored pixels?"
        )


def tilt_deg(camera: Camera) -> float:
    """The angle of the head's up axis in the picture, -180 to 180; 0 is upright, positive clockwise."""
    right, down = nearest_weak_perspective(camera).rotation[:2, 1]
    return float(np.degrees(np.arctan2(right, -down)))


def _faces_away(model: LandmarkModel, points2d: Float64[ndarray, "68 2"]) -> bool:
    try:
        return facing_deg(fit_mean_to_landmarks(model, points2d, robust=True)) > 90
    except DegenerateGeometryError:
        return False
