"""Landmarks as 300-W annotates them: jaw points where the face ends in the picture, not at fixed points of the skin.

The two agree on a frontal face. On a turned one they are several per cent of the face apart on the far side.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.fitting.face_fit import FaceFit
from pix2face.fitting.jaw_contour import JawContour
from pix2face.geometry.landmarks import IBUG68_PARTS
from pix2face.models.morphable_model import MorphableModel

JAW = list(IBUG68_PARTS["jaw"])


def with_contour(fit: FaceFit) -> FaceFit:
    """The fit with its jaw landmarks (2D; those in space stay) slid to the visible outline."""
    return replace(fit, landmarks2d=contour_landmarks2d(fit, fit.model))


def contour_landmarks2d(fit: FaceFit, model: MorphableModel) -> Float64[ndarray, "68 2"]:
    """The 68 landmarks of a fit with the jaw points slid to the visible outline.

    Args:
        fit: Fitted with the landmarks ibug68 of ``model``.
        model: The model of the fit.

    Returns:
        Pixels of the fit. The 51 inner points are those of the fit.

    Source: as ``fitting.jaw_contour``.
    """
    contour = _contour_of(model)
    coefficients = np.concatenate([fit.identity, fit.expression])
    outermost = contour.outermost(fit.camera, coefficients)
    points = contour.mean[outermost] + np.tensordot(coefficients, contour.basis[:, outermost], axes=1)
    landmarks2d = fit.landmarks2d.copy()
    landmarks2d[JAW] = fit.camera.project(points)
    return landmarks2d


@lru_cache(maxsize=2)
def _contour_of(model: MorphableModel) -> JawContour:
    return JawContour.of(model)
