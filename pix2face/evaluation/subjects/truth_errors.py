"""Errors of maps and of coefficients, which need renders, because nobody can annotate these in photographs."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar, final

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFace
from pix2face.evaluation.subjects.subjects import FoundFace
from pix2face.geometry.jitter import crop_maps
from pix2face.geometry.maps import FaceMaps
from pix2face.models.morphable_model import MorphableModel


@final
@dataclass(frozen=True)
class MapErrors:
    """How far predicted maps are from the true ones, over the pixels of the crop that are face in both."""

    pncc_mm: float | None  # mean distance; None where no pixel is common
    offset_mm: float | None  # mean distance
    offset_baseline_mm: float | None  # mean length of the true offset: the error of predicting 0
    mask_iou: float  # pixels that are face in both, divided by pixels that are face in either


@final
@dataclass(frozen=True)
class CoefficientErrors:
    """How far fitted coefficients are from the true ones. A baseline is the error of saying 0."""

    identity_rms: float | None  # over the components, in standard deviations; None without components
    identity_baseline_rms: float | None
    expression_rms: float | None  # as for the identity
    expression_baseline_rms: float | None
    shape_mm: float  # mean distance of the face's vertices in the model frame, without any alignment or camera
    shape_baseline_mm: float


Errors = TypeVar("Errors", MapErrors, CoefficientErrors)


def compare_maps(found: FoundFace, face: BenchmarkFace) -> MapErrors | None:
    """Errors of the maps that were predicted for a face, in the pixels of the crop; None where either has none."""
    if face.maps is None or found.maps is None or found.crop is None:
        return None
    return errors_of_maps(found.maps, crop_maps(face.maps, found.crop))


def errors_of_maps(predicted: FaceMaps, truth: FaceMaps) -> MapErrors:
    """Errors of predicted maps against true ones of the same pixels."""
    common, either = predicted.mask & truth.mask, predicted.mask | truth.mask
    iou = float(common.sum() / either.sum()) if either.any() else 1.0
    if not common.any():
        return MapErrors(None, None, None, iou)
    return MapErrors(
        pncc_mm=_mean_length(predicted.pncc[common] - truth.pncc[common]),
        offset_mm=_mean_length(predicted.offset[common] - truth.offset[common]),
        offset_baseline_mm=_mean_length(truth.offset[common]),
        mask_iou=iou,
    )


def compare_coefficients(model: MorphableModel, found: FoundFace, face: BenchmarkFace) -> CoefficientErrors | None:
    """Errors of fitted coefficients; None where truth or fit has none."""
    if face.identity is None or face.expression is None or found.identity is None or found.expression is None:
        return None
    visible = model.is_face_vertex
    own, true = (
        model.vertices(np.asarray(identity)[None], np.asarray(expression)[None])[0][visible]
        for identity, expression in ((found.identity, found.expression), (face.identity, face.expression))
    )
    return CoefficientErrors(
        identity_rms=_rms(found.identity - face.identity),
        identity_baseline_rms=_rms(face.identity),
        expression_rms=_rms(found.expression - face.expression),
        expression_baseline_rms=_rms(face.expression),
        shape_mm=_mean_length(own - true),
        shape_baseline_mm=_mean_length(model.mean[visible] - true),
    )


def mean_errors(errors: Sequence[Errors | None]) -> Errors | None:
    """Means over the images whose errors are known, each figure over those that have it; None without any."""
    known = [error for error in errors if error is not None]
    if not known:
        return None
    means: dict[str, Any] = {
        own.name: _mean_of_known([getattr(error, own.name) for error in known]) for own in fields(known[0])
    }
    return replace(known[0], **means)


def _mean_of_known(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _rms(values: Float[ndarray, " k"]) -> float | None:
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64)))) if len(values) else None


def _mean_length(vectors: Float[ndarray, "n 3"]) -> float:
    return float(np.linalg.norm(vectors, axis=1).mean(dtype=np.float64))
