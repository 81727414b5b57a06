"""Sizes and biases of the errors of the head's pose, in bins of the true yaw."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.evaluation.benchmarks.benchmark_data import YAW_BINS, yaw_bin

ANGLES = ("pitch", "yaw", "roll")
ALL_FACES = "all"


@final
@dataclass(frozen=True, eq=False)
class PoseErrors:
    """Errors of the pose of a head, degrees."""

    angles: Float64[ndarray, "3"]  # found minus true pitch, yaw, roll
    rotation: float  # the angle between the found and the true head, 0 to 180


@final
@dataclass(frozen=True)
class PoseSummary:
    """Errors of a set of poses, degrees."""

    n_images: int  # faces whose pose is known and was found
    mean_absolute_deg: dict[str, float | None]  # for pitch, yaw and roll; None without faces
    bias_deg: dict[str, float | None]  # mean of found minus true
    mean_of_angles_deg: float | None  # of the three mean absolute errors; the figure that the literature compares
    mean_rotation_deg: float | None  # mean of the angles between the found and the true head
    yaw_shrinkage_deg: float | None  # mean of found minus true |yaw|; below 0 where heads are found less turned


def summarise_poses(
    yaws_deg: Sequence[float | None], errors: Sequence[PoseErrors | None]
) -> dict[str, PoseSummary] | None:
    """Errors of the pose for each bin of the true |yaw|, and for all faces; None where no face has both."""
    known = [
        (yaw, own.angles, own.rotation)
        for yaw, own in zip(yaws_deg, errors, strict=True)
        if yaw is not None and own is not None
    ]
    if not known:
        return None
    yaws, angles, rotations = (np.array(column, dtype=np.float64) for column in zip(*known, strict=True))
    bins = np.array([yaw_bin(float(yaw)) for yaw in yaws], dtype=np.str_)
    chosen = {name: bins == name for name in YAW_BINS} | {ALL_FACES: np.ones(len(bins), dtype=bool)}
    return {name: _summarise(yaws[rows], angles[rows], rotations[rows]) for name, rows in chosen.items()}


def _summarise(
    yaws: Float64[ndarray, " n"], errors: Float64[ndarray, "n 3"], rotations: Float64[ndarray, " n"]
) -> PoseSummary:
    if not len(errors):
        nothing: dict[str, float | None] = dict.fromkeys(ANGLES)
        return PoseSummary(0, nothing, dict(nothing), None, None, None)
    absolute, bias = np.abs(errors).mean(axis=0), errors.mean(axis=0)
    return PoseSummary(
        n_images=len(errors),
        mean_absolute_deg=dict(zip(ANGLES, absolute.tolist(), strict=True)),
        bias_deg=dict(zip(ANGLES, bias.tolist(), strict=True)),
        mean_of_angles_deg=float(absolute.mean()),
        mean_rotation_deg=float(rotations.mean()),
        yaw_shrinkage_deg=float((np.abs(yaws + errors[:, 1]) - np.abs(yaws)).mean()),
    )
