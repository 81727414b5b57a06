"""What networks answer, whatever runs them: onnxruntime on the CPU, torch on GPUs and in training."""

from dataclasses import dataclass
from typing import Protocol, final, runtime_checkable

from jaxtyping import Float32
from numpy import ndarray


@final
@dataclass(frozen=True, eq=False)
class Answers:
    """What a network answers for some pictures."""

    planes: Float32[ndarray, "b s s planes"]  # maps in units of the header's scales, then logits of masks
    landmarks: Float32[ndarray, "b n 3"] | None = None  # ``pix2face.networks.LANDMARK_NUMBERS``
    seen: Float32[ndarray, "b k"] | None = None  # what the correction of fits goes by


@runtime_checkable
class Network(Protocol):
    """A network that reads RGB crops, each value divided by 255, minus 0.5."""

    def answers(self, pictures: Float32[ndarray, "b s s 3"]) -> Answers:
        """Everything that it answers."""

    def landmarks(self, pictures: Float32[ndarray, "b s s 3"]) -> Float32[ndarray, "b n 3"]:
        """The landmarks alone, of a network that predicts them: on the CPU in half the time."""
