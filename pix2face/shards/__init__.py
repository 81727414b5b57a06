"""The shard format: what a sample holds, and how shards are written, read and checked.

``ShardDataset`` is what a trainer of your own needs. It is loaded on first use and needs no torch.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pix2face.shards.sample import Sample
    from pix2face.shards.shard_dataset import ShardDataset

__all__ = ["Sample", "ShardDataset"]


def __getattr__(name: str) -> Any:
    """Loads the public classes when they are asked for: the table of layers alone needs no HDF5."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from pix2face.shards import sample, shard_dataset

    return getattr(sample if name == "Sample" else shard_dataset, name)
