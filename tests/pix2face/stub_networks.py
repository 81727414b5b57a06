"""Networks that are functions of tensors, as ``Predictor`` takes them."""

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from pix2face.inference.answers import Answers, Network
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.predictor import Predictor


def as_network(network: Callable[[Tensor], Tensor]) -> Network:
    def answers(pictures: np.ndarray) -> Answers:
        with torch.no_grad():
            planes = network(torch.from_numpy(pictures).permute(0, 3, 1, 2))
        return Answers(np.ascontiguousarray(planes.float().permute(0, 2, 3, 1).numpy()))

    return answers


def predictor_of(network: Callable[[Tensor], Tensor], header: CheckpointHeader) -> Predictor:
    return Predictor(as_network(network), header)
