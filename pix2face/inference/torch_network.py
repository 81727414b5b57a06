"""Runs networks by torch: on GPUs, and while they are trained."""

import numpy as np
import torch
from jaxtyping import Float32
from numpy import ndarray
from torch import nn

from pix2face.errors import UsageError
from pix2face.inference.answers import Answers, Network
from pix2face.networks.residual import ResidualUNet


def run_by_torch(network: nn.Module, device: torch.device | str = "cpu") -> Network:
    """A network as a function of arrays. It is moved to the device, and its norms are as in use."""
    network = network.eval().to(device)

    def answers(pictures: Float32[ndarray, "b s s 3"]) -> Answers:
        with torch.inference_mode():
            batch = torch.from_numpy(pictures).permute(0, 3, 1, 2).to(device)
            landmarks = seen = None
            if isinstance(network, ResidualUNet):
                planes, landmarks, levels = network.read(batch)
                if network.correction is not None:
                    seen = network.correction.seen([level.float() for level in levels])
            else:
                planes = network(batch)
            found = (None if own is None else own.float().cpu().numpy() for own in (landmarks, seen))
            last = planes.float().permute(0, 2, 3, 1).cpu().numpy()
            return Answers(np.ascontiguousarray(last), *found)

    return answers


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
