"""Several pictures of one person: one identity, and a camera and an expression for each picture (Eq. 5)."""

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.fitting.face_fit import FaceFit, check_scheme, face_of_coefficients
from pix2face.fitting.fit_options import DEFAULT_FIT, FitOptions
from pix2face.fitting.least_squares.linear_system import JointAccumulator
from pix2face.fitting.picture_measurement import measure_picture
from pix2face.geometry.landmarks import IBUG68
from pix2face.geometry.maps import FaceMaps
from pix2face.models.morphable_model import MorphableModel


def fit_joint(
    maps: Iterable[FaceMaps],
    model: MorphableModel,
    options: FitOptions = DEFAULT_FIT,
    *,
    principal_points_px: Sequence[Float[ndarray, "2"] | None] | None = None,
    scheme: str = IBUG68,
) -> list[FaceFit]:
    """Fits pictures of one person together: the identity is shared, cameras and expressions are not.

    Maps are read one after the other, so they may come from a generator. For each picture, only its camera and a block
    of (expressions x identities) numbers are kept. Time and memory are linear in the number of pictures.

    Args:
        maps: Maps of each picture.
        model: The morphable model of the maps.
        options: As in ``fit_face``. With the regularisation "estimate", lambda is estimated for each picture, so that
            noisy pictures count less. The penalty on the identity counts once, whatever the number of pictures.
        principal_points_px: As in ``fit_face``, one for each picture.
        scheme: As in ``fit_face``.

    Returns:
        A fit for each picture, in the pixels of its maps; all have the same identity.

    Raises:
        DegenerateGeometryError: As ``fit_face``, or there is no picture.
        UsageError: As ``fit_face``, or rounds of reprojection are asked for.

    Source: Crispell and Bazik 2017, Eq. 5.
    """
    check_scheme(model, scheme)
    if options.reprojection_rounds:
        raise UsageError("expected no --reprojection-rounds with --joint, whose fits have no more rounds")
    joint, cameras, landmarks = JointAccumulator(model.n_identity), [], []
    for index, own in enumerate(maps):
        measured = measure_picture(
            own, model, options, principal_point_px=None if principal_points_px is None else principal_points_px[index]
        )
        joint.add(measured.system, measured.regularisation)
        cameras.append(measured.camera)
        landmarks.append(own.landmarks)
    identity, expressions = joint.solve()
    return [
        face_of_coefficients(
            model, camera, identity, np.asarray(expression), scheme=scheme, landmark_type=options.landmark_type
        ).with_errors_of(predicted)
        for camera, expression, predicted in zip(cameras, expressions, landmarks, strict=True)
    ]
