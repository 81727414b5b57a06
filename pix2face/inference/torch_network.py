"""Runs networks by torch: on GPUs, and while they are trained."""

from typing import final

import numpy as np
import torch
from jaxtyping import Float32
from numpy import ndarray
from torch import nn

from pix2face.errors import UsageError
from pix2face.inference.answers import Answers
from pix2face.networks.residual import ResidualUNet


@final
class TorchNetwork:
    """A ``pix2face.inference.answers.Network`` that torch runs. The network is moved to the device.

    Args:
        network: Its norms are as in use from now on.
        device: Where it is run.
    """

    def __init__(self, network: nn.Module, device: torch.device | str = "cpu") -> None:
        self._network, self._device = network.eval().to(device), device

    def answers(self, pictures: Float32[ndarray, "b s s 3"]) -> Answers:
        """Everything that it answers."""
        network = self._network
        with torch.inference_mode():
            batch = torch.from_numpy(pictures).permute(0, 3, 1, 2).to(self._device)
            landmarks = seen = None
            if isinstance(network, ResidualUNet):
                planes, landmarks, levels = network.read(batch)
                if network.correction is not None:
                    seen = network.correction.seen(levels)
            else:
                planes = network(batch)
            found = (None if own is None else own.float().cpu().numpy() for own in (landmarks, seen))
            return Answers(np.ascontiguousarray(planes.float().permute(0, 2, 3, 1).cpu().numpy()), *found)

    def landmarks(self, pictures: Float32[ndarray, "b s s 3"]) -> Float32[ndarray, "b n 3"]:
        """The landmarks alone."""
        landmarks = self.answers(pictures).landmarks
        assert landmarks is not None
        return landmarks


def torch_device(name: str | None) -> torch.device:
    """The device with a name; None selects a GPU if there is one.

    Raises:
        UsageError: There is no such device.
    """
    try:
        device = torch.device(name or ("cuda" if torch.cuda.is_available() else "cpu"))
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        reason = str(error).splitlines()[0]
        raise UsageError(f"expected a torch device that is there, such as cpu, found {name!r} ({reason})") from error
    return device
