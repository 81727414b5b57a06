"""A network with the fit to its own maps in the middle: pictures in, maps, fits and corrected fits out."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import final

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, UInt8
from numpy import ndarray
from torch import Tensor, nn

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.fit_options import FitOptions
from pix2face.fitting.picture_measurement import measure_picture
from pix2face.geometry.camera import Camera
from pix2face.geometry.maps import FaceMaps
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.fit_correction import centred_rows
from pix2face.inference.predictor import read_planes
from pix2face.models.morphable_model import MorphableModel
from pix2face.networks.residual import ResidualUNet

# What is corrected are the default fits.
FIT = FitOptions(correction=False)
# Where the maps hold no face. It does not count, but its logarithm must be finite.
NO_SCALE = 0.005

Fit = Callable[[FaceMaps], tuple[Camera, Float64[ndarray, " c"]] | None]


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class ReadFaces:
    """What a network says of some faces. Cameras map mm to units of the crop's side, from its middle."""

    planes: Float[Tensor, "b planes s s"]
    landmarks: Float[Tensor, "b n 3"] | None
    is_fitted: Bool[Tensor, " b"]  # False where the maps held no face; such rows do not count
    fitted_coefficients: Float[Tensor, "b c"]  # standard deviations
    cameras: Float[Tensor, "b 2 4"]  # corrected
    coefficients: Float[Tensor, "b c"]  # corrected


@final
class FittingNetwork(nn.Module):
    """Reads faces: the network, the fit to its maps, and the correction of the fit.

    Gradients do not pass through the fit. The network keeps the statistics of its norms, so that it is trained as it is
    used.

    Args:
        network: With a correction.
        header: The header of its checkpoint.
        fit: Fits the morphable model to maps; returns None where there is no face.
        is_frozen: Only the correction learns, with the statistics of each batch, and not the network.
    """

    def __init__(self, network: ResidualUNet, header: CheckpointHeader, fit: Fit, *, is_frozen: bool) -> None:
        super().__init__()
        assert network.correction is not None
        self.network, self._header, self._fit, self._is_frozen = network, header, fit, is_frozen
        if is_frozen:
            network.requires_grad_(False)
            network.correction.requires_grad_(True)

    def train(self, mode: bool = True) -> "FittingNetwork":
        """Turns dropout on or off."""
        super().train(mode)
        correction = self.network.correction
        assert correction is not None
        self.network.eval()
        if self._is_frozen:
            correction.train(mode)
        else:
            correction.training = mode  # dropout, but not the norms within
        return self

    def forward(self, image: Float[Tensor, "b 3 s s"], in_photograph: UInt8[Tensor, "b s s"]) -> ReadFaces:
        """Reads some crops; ``in_photograph`` is 1 where they show the photograph, and 0 beyond its border."""
        with torch.set_grad_enabled(torch.is_grad_enabled() and not self._is_frozen):
            planes, landmarks, levels = self.network.read(image)
        cameras, fitted, is_fitted = self._fits(planes, in_photograph)
        assert self.network.correction is not None
        corrected, coefficients = self.network.correction(levels, cameras, fitted)
        return ReadFaces(
            planes=planes,
            landmarks=landmarks,
            is_fitted=is_fitted,
            fitted_coefficients=fitted,
            cameras=corrected,
            coefficients=coefficients,
        )

    def _fits(
        self, planes: Float[Tensor, "b planes s s"], in_photograph: UInt8[Tensor, "b s s"]
    ) -> tuple[Float[Tensor, "b 2 4"], Float[Tensor, "b c"], Bool[Tensor, " b"]]:
        answers = np.ascontiguousarray(planes.detach().float().permute(0, 2, 3, 1).cpu().numpy())
        insides = in_photograph.cpu().numpy().astype(bool)
        found = [
            self._fit(replace(read_planes(answer, self._header)[0], in_photograph=None if inside.all() else inside))
            for answer, inside in zip(answers, insides, strict=True)
        ]
        cameras = np.tile(NO_SCALE * np.eye(2, 4), (len(found), 1, 1))
        coefficients = np.zeros((len(found), self._header.n_corrected))
        for place, fit in enumerate(found):
            if fit is not None:
                cameras[place], coefficients[place] = centred_rows(fit[0], self._header.size_px), fit[1]
        is_fitted = torch.tensor([fit is not None for fit in found], device=planes.device)
        own_cameras, own = (
            torch.from_numpy(values).to(planes.device, torch.float32) for values in (cameras, coefficients)
        )
        return own_cameras, own, is_fitted


def fit_of(model: MorphableModel) -> Fit:
    """What fits a model to maps. A function, so that copies of a network share the model."""

    def fit(maps: FaceMaps) -> tuple[Camera, Float64[ndarray, " c"]] | None:
        try:
            measured = measure_picture(maps, model, FIT)
        except DegenerateGeometryError:
            return None
        return measured.camera, measured.coefficients

    return fit
