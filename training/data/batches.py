"""Batches as they go from the loader to the trainer: pictures as bytes and maps in integer steps.

They become floating-point numbers where the network runs: a sample of 128 px is 262 kB this way and 590 kB as float32.
Channels are last in memory (``torch.channels_last``), as in files and as convolutions run fastest, so that nothing is
transposed on the way.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from mmap import mmap
from typing import Any, Generic, TypeVar, final

import torch
from jaxtyping import Float32, Int16, UInt8
from torch import Tensor

from pix2face.geometry.maps import FIXED_POINT_STEPS_PER_MM
from training.data.decoded_sample import DecodedSample

LARGEST_BYTE = 255
# Type and shape of tensors by name, in the order in which they lie in memory: larger types first.
Layout = Mapping[str, tuple[torch.dtype, tuple[int, ...]]]


@dataclass(frozen=True, eq=False, kw_only=True)
class TrainingBatch(ABC):
    """Some samples: a dataclass whose fields are tensors, batches or None."""

    @abstractmethod
    def network_input(self) -> tuple[Any, ...]:
        """The arguments of the network."""

    def __len__(self) -> int:
        return len(next(iter(vars(self).values())))

    def __getitem__(self: "B", rows: slice) -> "B":
        """Some of the samples, not copied."""
        return self._each(lambda part: part[rows])

    def to(self: "B", device: torch.device | str, *, non_blocking: bool = False) -> "B":
        """Returns the batch on another device."""
        return self._each(lambda part: part.to(device, non_blocking=non_blocking))

    def pin_memory(self: "B") -> "B":
        """Returns the batch in pinned memory, from which a GPU copies by itself."""
        return self._each(lambda part: part.pin_memory())

    def _each(self: "B", change: Callable[[Any], Any]) -> "B":
        return replace(self, **{name: None if part is None else change(part) for name, part in vars(self).items()})


B = TypeVar("B", bound=TrainingBatch)


class Draws(ABC, Generic[B]):
    """Numbered draws, a batch at a time: what processes can load. It is copied to each of them."""

    @abstractmethod
    def layout(self, n_samples: int) -> Layout:
        """The tensors of a batch."""

    @abstractmethod
    def of_tensors(self, tensors: Mapping[str, Tensor]) -> B:
        """The batch that has these tensors."""

    @abstractmethod
    def fill_row(self, batch: B, place: int, draw: int) -> None:
        """Fills a row of a batch, which is full of 0.

        Raises:
            InputFileError: A sample is damaged.
            UsageError: A picture is too small to be cut from.
        """

    def batch(self, draws: Sequence[int], memory: mmap | None = None) -> B:
        """Some draws, by their numbers from 0 without end; in memory of the size of their layout, or in new memory.

        Raises:
            InputFileError: A sample is damaged.
            UsageError: A picture is too small to be cut from.
        """
        batch = self.of_tensors(tensors_in(self.layout(len(draws)), memory))
        for place, draw in enumerate(draws):
            self.fill_row(batch, place, draw)
        return batch


def layout_bytes(layout: Layout) -> int:
    """The memory that tensors take."""
    return sum(dtype.itemsize * math.prod(shape) for dtype, shape in layout.values())


def tensors_in(layout: Layout, memory: mmap | None = None) -> dict[str, Tensor]:
    """Tensors in memory of ``layout_bytes``, with what lies there; None takes new memory, full of 0."""
    sizes = [dtype.itemsize * math.prod(shape) for dtype, shape in layout.values()]
    whole = (
        torch.zeros(sum(sizes), dtype=torch.uint8) if memory is None else torch.frombuffer(memory, dtype=torch.uint8)
    )
    parts = zip(layout.items(), torch.split_with_sizes(whole, sizes), strict=True)
    return {name: part.view(dtype).view(shape) for (name, (dtype, shape)), part in parts}


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Batch(TrainingBatch):
    """Some samples."""

    image: UInt8[Tensor, "b 3 s s"]  # RGB
    pncc: Int16[Tensor, "b 3 s s"]  # steps of 1/128 mm, model frame; 0 in the background
    offset: Int16[Tensor, "b 3 s s"]  # likewise
    mask: UInt8[Tensor, "b s s"]  # 1 where both maps hold, also behind what covers the face; else 0
    seen: UInt8[Tensor, "b s s"] | None  # 1 where the picture shows the face; None if a set does not know
    landmarks2d: Float32[Tensor, "b n 2"]  # px, seen or hidden; n is 0 where they are not trained on

    def network_input(self) -> tuple[Float32[Tensor, "b 3 s s"]]:
        """The pictures, as the network takes them."""
        return (as_input(self.image),)


def as_input(image: UInt8[Tensor, "b 3 h w"]) -> Float32[Tensor, "b 3 h w"]:
    """Pictures as networks take them, in [-0.5, 0.5]."""
    return image.float().div_(LARGEST_BYTE).sub_(0.5)


def target_planes(batch: Batch, pncc_scale_mm: float, offset_scale_mm: float) -> Float32[Tensor, "b 6 s s"]:
    """PNCC and offset divided by their scales, as the network is to predict them."""
    planes = torch.cat([batch.pncc, batch.offset], dim=1).float()
    scales_mm = torch.tensor([pncc_scale_mm] * 3 + [offset_scale_mm] * 3, device=planes.device)
    return planes.div_((scales_mm * FIXED_POINT_STEPS_PER_MM)[:, None, None])


def batch_layout(n_samples: int, size_px: int, *, has_seen: bool, n_landmarks: int = 0) -> Layout:
    """The tensors of a batch of pictures of a size, each with ``n_landmarks`` landmarks."""
    square = (n_samples, size_px, size_px)
    layout: Layout = {
        "landmarks2d": (torch.float32, (n_samples, n_landmarks, 2)),
        "pncc": (torch.int16, (*square, 3)),
        "offset": (torch.int16, (*square, 3)),
        "image": (torch.uint8, (*square, 3)),
        "mask": (torch.uint8, square),
    }
    return {**layout, "seen": (torch.uint8, square)} if has_seen else layout


def batch_of(tensors: Mapping[str, Tensor]) -> Batch:
    """The batch that has the tensors of ``batch_layout``: channels last in memory."""
    parts: dict[str, Any] = {"seen": None, **tensors}
    for name in ("image", "pncc", "offset"):
        parts[name] = tensors[name].permute(0, 3, 1, 2)
    return Batch(**parts)


def empty_batch(n_samples: int, size_px: int, *, has_seen: bool) -> Batch:
    """A batch full of 0, without landmarks."""
    return batch_of(tensors_in(batch_layout(n_samples, size_px, has_seen=has_seen)))


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
