"""Batches as they go from the loader to the trainer: pictures as bytes and maps in integer steps.

They become floating-point numbers where the network runs: a sample of 128 px is 262 kB this way and 590 kB as float32.
Channels are last in memory (``torch.channels_last``), as in files and as convolutions run fastest, so that nothing is
transposed on the way.
"""

from collections.abc import Callable
from dataclasses import dataclass
from mmap import mmap
from typing import Any, Protocol, final, runtime_checkable

import torch
from jaxtyping import Float32, Int16, UInt8
from torch import Tensor

from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM
from training.data.decoded_sample import DecodedSample

LARGEST_BYTE = 255
# Three planes each of a picture (bytes), PNCC and offset (two bytes), and the mask.
_BYTES_A_PIXEL = 3 + 6 + 6 + 1
_BYTES_A_LANDMARK = 8


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Batch:
    """Some samples."""

    image: UInt8[Tensor, "b 3 s s"]  # RGB
    pncc: Int16[Tensor, "b 3 s s"]  # steps of 1/128 mm, model frame; 0 in the background
    offset: Int16[Tensor, "b 3 s s"]  # likewise
    mask: UInt8[Tensor, "b s s"]  # 1 where both maps hold, also behind what covers the face; else 0
    seen: UInt8[Tensor, "b s s"] | None  # 1 where the picture shows the face; None if a set does not know
    landmarks2d: Float32[Tensor, "b n 2"]  # px, seen or hidden; n is 0 where they are not trained on

    def __len__(self) -> int:
        return len(self.image)

    def network_input(self) -> tuple[Float32[Tensor, "b 3 s s"]]:
        """The pictures, as the network takes them."""
        return (as_input(self.image),)

    def to(self, device: torch.device | str, *, non_blocking: bool = False) -> "Batch":
        """Returns the batch on another device."""
        return self._each(lambda tensor: tensor.to(device, non_blocking=non_blocking))

    def pin_memory(self) -> "Batch":
        """Returns the batch in pinned memory, from which a GPU copies by itself."""
        return self._each(lambda tensor: tensor.pin_memory())

    def rows(self, first: int, end: int) -> "Batch":
        """Some of the samples, not copied."""
        return self._each(lambda tensor: tensor[first:end])

    def _each(self, change: Callable[[Tensor], Tensor]) -> "Batch":
        return Batch(
            image=change(self.image),
            pncc=change(self.pncc),
            offset=change(self.offset),
            mask=change(self.mask),
            seen=None if self.seen is None else change(self.seen),
            landmarks2d=change(self.landmarks2d),
        )


@runtime_checkable
class TrainingBatch(Protocol):
    """What the trainer needs to know of a batch."""

    def __len__(self) -> int: ...

    def network_input(self) -> tuple[Any, ...]:
        """The arguments of the network."""

    def to(self, device: torch.device | str, *, non_blocking: bool = False) -> "TrainingBatch":
        """Returns the batch on another device."""

    def pin_memory(self) -> "TrainingBatch":
        """Returns the batch in pinned memory."""

    def rows(self, first: int, end: int) -> "TrainingBatch":
        """Some of the samples, not copied."""


def as_input(image: UInt8[Tensor, "b 3 h w"]) -> Float32[Tensor, "b 3 h w"]:
    """Pictures as networks take them, in [-0.5, 0.5]."""
    return image.float().div_(LARGEST_BYTE).sub_(0.5)


def target_planes(batch: Batch, pncc_scale_mm: float, offset_scale_mm: float) -> Float32[Tensor, "b 6 s s"]:
    """PNCC and offset divided by their scales, as the network is to predict them."""
    planes = torch.cat([batch.pncc, batch.offset], dim=1).float()
    scales_mm = torch.tensor([pncc_scale_mm] * 3 + [offset_scale_mm] * 3, device=planes.device)
    return planes.div_((scales_mm * FIXED_POINT_STEPS_PER_MM)[:, None, None])


def batch_bytes(n_samples: int, size_px: int, *, has_seen: bool, n_landmarks: int = 0) -> int:
    """The memory that a batch takes."""
    return n_samples * (size_px**2 * (_BYTES_A_PIXEL + has_seen) + n_landmarks * _BYTES_A_LANDMARK)


def empty_batch(
    n_samples: int, size_px: int, *, has_seen: bool, n_landmarks: int = 0, memory: mmap | memoryview | None = None
) -> Batch:
    """A batch full of 0, channels last in memory.

    Args:
        n_samples: At least 1.
        size_px: Side of the pictures.
        has_seen: Whether it has ``seen``.
        n_landmarks: How many landmarks each sample has.
        memory: Where it lies, of ``batch_bytes``, which may hold another batch already; None takes new memory.
    """
    n_bytes = batch_bytes(n_samples, size_px, has_seen=has_seen, n_landmarks=n_landmarks)
    content = torch.zeros(n_bytes, dtype=torch.uint8) if memory is None else torch.frombuffer(memory, dtype=torch.uint8)
    pixels = n_samples * size_px**2
    of_landmarks = n_samples * n_landmarks * _BYTES_A_LANDMARK
    sizes = [of_landmarks, 6 * pixels, 6 * pixels, 3 * pixels, pixels, has_seen * pixels]
    landmarks, pncc, offset, image, mask, seen = torch.split_with_sizes(content, sizes)

    def planes(values: Tensor) -> Tensor:
        return values.view(n_samples, size_px, size_px, 3).permute(0, 3, 1, 2)

    return Batch(
        image=planes(image),
        pncc=planes(pncc.view(torch.int16)),
        offset=planes(offset.view(torch.int16)),
        mask=mask.view(n_samples, size_px, size_px),
        seen=seen.view(n_samples, size_px, size_px) if has_seen else None,
        landmarks2d=landmarks.view(torch.float32).view(n_samples, n_landmarks, 2),
    )


def batch_row(batch: Batch, place: int) -> DecodedSample:
    """The row of one sample in a batch, to be written to."""
    return DecodedSample(
        image=batch.image[place].permute(1, 2, 0).numpy(),
        pncc=batch.pncc[place].permute(1, 2, 0).numpy(),
        offset=batch.offset[place].permute(1, 2, 0).numpy(),
        mask=batch.mask[place].numpy(),
        seen=None if batch.seen is None else batch.seen[place].numpy(),
        landmarks2d=batch.landmarks2d[place].numpy(),
    )
