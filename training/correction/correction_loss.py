"""What the correction of fits minimises: how far the corrected face is from the true one."""

from typing import final

import torch
from jaxtyping import Float, Float32
from numpy import ndarray
from torch import Tensor

from pix2face.networks.correction import rotation_and_scale
from training.correction.fitting_network import ReadFaces
from training.correction.known_faces import KnownFaces
from training.loop.losses import LossPlan

# The units of the parts differ: points in units of the face, turns as the distance of rotation matrices, shapes in mm.
WEIGHTS = {"points": 1.0, "camera": 0.5, "turn": 0.06, "shape": 0.001}
# Of their sum, beside the loss of the maps.
CORRECTION_WEIGHT = 2.0


@final
class CorrectionLosses:
    """The losses of a step.

    Args:
        mean: Points of the mean face, mm.
        basis: How coefficients move them, mm per standard deviation.
        maps: The loss of the maps; None where the network does not learn.
    """

    def __init__(self, mean: Float32[ndarray, "p 3"], basis: Float32[ndarray, "p 3 c"], maps: LossPlan | None) -> None:
        self._mean, self._basis, self._maps = torch.from_numpy(mean), torch.from_numpy(basis), maps

    def parts(self, answer: ReadFaces, batch: KnownFaces) -> dict[str, Float[Tensor, ""]]:
        """Each part of the loss by its name, unweighted.

        Mean distances of points in the picture, in units of sqrt(w h) of their box, of the corrected face (points) and
        of the fitted face with the corrected camera (camera); the distance of rotations (turn); the mean distance
        of points in the model frame in mm (shape); and the parts of the loss of the maps.
        """
        size = (batch.points2d.amax(dim=1) - batch.points2d.amin(dim=1)).prod(dim=1).sqrt()
        points, fitted = self._points(answer.coefficients), self._points(answer.fitted_coefficients)
        turn = rotation_and_scale(answer.cameras)[0] - rotation_and_scale(batch.cameras)[0]
        each = {
            "points": (_projected(answer.cameras, points) - batch.points2d).norm(dim=2).mean(dim=1) / size,
            "camera": (_projected(answer.cameras, fitted) - batch.points2d).norm(dim=2).mean(dim=1) / size,
            "turn": turn.flatten(1).norm(dim=1),
            "shape": (points - self._points(batch.coefficients)).norm(dim=2).mean(dim=1),
        }
        counts = answer.is_fitted.float()
        parts = {name: (values * counts).sum() / counts.sum().clamp(min=1) for name, values in each.items()}
        if self._maps is None:
            return parts
        planes = answer.planes if answer.landmarks is None else (answer.planes, answer.landmarks)
        return parts | self._maps.parts(planes, batch.maps)

    def total(self, parts: dict[str, Float[Tensor, ""]]) -> Float[Tensor, ""]:
        """The weighted sum of the parts, and the loss of the maps."""
        total = torch.stack([weight * parts[name] for name, weight in WEIGHTS.items()]).sum()
        if self._maps is None:
            return total
        maps = self._maps.total({name: part for name, part in parts.items() if name not in WEIGHTS})
        return maps + CORRECTION_WEIGHT * total

    def _points(self, coefficients: Float[Tensor, "b c"]) -> Float[Tensor, "b p 3"]:
        basis = self._basis.to(coefficients.device)
        return self._mean.to(coefficients.device) + torch.einsum("pkc,bc->bpk", basis, coefficients)


def _projected(cameras: Float[Tensor, "b 2 4"], points: Float[Tensor, "b p 3"]) -> Float[Tensor, "b p 2"]:
    return points @ cameras[:, :, :3].mT + cameras[:, None, :, 3]
