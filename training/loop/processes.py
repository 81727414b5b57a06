"""Several processes that train one network, as ``torchrun`` starts them; one process alone is the special case.

Each computes its part of every batch, and gradients are averaged between them (DistributedDataParallel).
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor, distributed, nn
from torch.nn.parallel import DistributedDataParallel


@final
@dataclass(frozen=True)
class Processes:
    """Which of how many processes this is.

    Attributes:
        rank: From 0; 0 alone writes files.
        count: How many there are.
    """

    rank: int = 0
    count: int = 1

    @property
    def is_first(self) -> bool:
        """Whether this process is the one that writes."""
        return self.rank == 0

    def joined(self, network: nn.Module) -> nn.Module:
        """The network for a forward pass whose gradients all processes share. Its weights become rank 0's."""
        return network if self.count == 1 else DistributedDataParallel(network)

    def mean(self, values: Tensor) -> Tensor:
        """The mean over all processes."""
        if self.count > 1:
            distributed.all_reduce(values)
            values /= self.count
        return values

    def wait_for_all(self) -> None:
        """Returns when all processes have come here."""
        if self.count > 1:
            distributed.barrier()


def is_started_by_torchrun() -> bool:
    """Whether ``torchrun`` has started this process."""
    return "RANK" in os.environ and "WORLD_SIZE" in os.environ


def device_of_process(device: str) -> str:
    """The GPU of this process, where "cuda" stands for any."""
    return f"cuda:{os.environ.get('LOCAL_RANK', '0')}" if device == "cuda" and is_started_by_torchrun() else device


@contextmanager
def joined_processes(device: str) -> Iterator[Processes]:
    """Joins the other processes that ``torchrun`` has started; without it, this process is alone.

    Args:
        device: Of this process; decides by what it talks to the others (nccl between GPUs, else gloo).
    """
    if not is_started_by_torchrun():
        yield Processes()
        return
    if device.startswith("cuda"):
        torch.cuda.set_device(device)
    distributed.init_process_group("nccl" if device.startswith("cuda") else "gloo")
    try:
        yield Processes(distributed.get_rank(), distributed.get_world_size())
    finally:
        distributed.destroy_process_group()
