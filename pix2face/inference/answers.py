"""What networks answer, whatever runs them: onnxruntime on the CPU, torch on GPUs and in training."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

from jaxtyping import Float32
from numpy import ndarray


@final
@dataclass(frozen=True, eq=False)
class Answers:
    """Of some pictures."""

    planes: Float32[ndarray, "b s s planes"]  # maps in units of the header's scales, then logits of masks
    landmarks: Float32[ndarray, "b n 3"] | None = None  # ``pix2face.networks.LANDMARK_NUMBERS``
    seen: Float32[ndarray, "b k"] | None = None  # what the correction of fits goes by


# From RGB crops, each value divided by 255, minus 0.5.
Network = Callable[[Float32[ndarray, "b s s 3"]], Answers]
