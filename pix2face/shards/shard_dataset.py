"""Shards as a data set for any trainer."""

from bisect import bisect_right
from collections.abc import Iterable, Sequence
from itertools import accumulate
from operator import index as whole_number
from os import PathLike
from pathlib import Path
from typing import SupportsIndex, final, overload

from pix2face.errors import ModelMismatchError, UsageError
from pix2face.shards.layers import order_layers
from pix2face.shards.sample import Sample, check_has_layers
from pix2face.shards.shard_reader import ShardHeader, ShardReader, shard_paths


@final
class ShardDataset(Sequence[Sample]):
    """The samples of a folder of shards, in any order: ``dataset[i]`` reads one of them from its file.

    It is an ordinary sequence (length, index, iteration) of ``Sample``, whose arrays are NumPy's, and needs no torch.
    It keeps no file open, so it can be pickled, forked and handed to the workers of
    ``torch.utils.data.DataLoader``. It takes about 200 bytes of memory per sample.

    Example:
        >>> dataset = ShardDataset("shards/", layers=("image", "pncc", "offset", "mask"))
        >>> sample = dataset[0]
        >>> sample.image  # (h, w, 3) uint8, RGB
        >>> sample.layers["pncc"]  # (h, w, 3) float32, mm in the model frame, 0 outside the mask
        >>> sample.layers["mask"]  # (h, w) bool
        >>> sample.camera.project(sample.landmarks3d)  # (68, 2) pixels, centres at +0.5

    Args:
        shards: A folder of ``shard-*.h5``, or the paths of some shards.
        layers: Names of the layers to read (``pix2face.shards.layers.LAYER_NAMES``); ``image`` is the picture. None
            reads all layers of the first shard. Camera, coefficients, landmarks and attributes are always read.

    Attributes:
        header: Header of the first shard: model, licence, layers, names of regions.
        layers: The layers that are read.

    Raises:
        UsageError: There is no shard, a name is unknown, or a shard lacks a layer.
        InputFileError: A shard is missing, damaged or of another schema.
        ModelMismatchError: The shards are of different morphable models, whose maps do not match.
    """

    def __init__(
        self, shards: str | PathLike[str] | Iterable[str | PathLike[str]], layers: Sequence[str] | None = None
    ) -> None:
        paths = shard_paths(Path(shards)) if isinstance(shards, str | PathLike) else [Path(path) for path in shards]
        if not paths:
            raise UsageError("expected a folder of shards or the paths of some, found an empty list")
        self._readers = [ShardReader(path) for path in paths]
        self._ends = list(accumulate(len(reader) for reader in self._readers))
        self.header: ShardHeader = self._readers[0].header
        self.layers: tuple[str, ...] = self.header.layers if layers is None else order_layers(layers)
        for reader in self._readers:
            check_has_layers(reader.header.layers, self.layers, str(reader.path))
            if reader.header.model_sha256 != self.header.model_sha256:
                raise ModelMismatchError(
                    f"{reader.path}: expected shards of one morphable model, found {reader.header.model_name} "
                    f"({reader.header.model_sha256[:12]}) beside {self.header.model_name} "
                    f"({self.header.model_sha256[:12]}); make a data set of each"
                )

    def __len__(self) -> int:
        return self._ends[-1]

    @overload
    def __getitem__(self, index: SupportsIndex) -> Sample: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Sample]: ...
    def __getitem__(self, index: SupportsIndex | slice) -> Sample | Sequence[Sample]:
        """Reads one sample: from 0, in the order of the files; negative numbers count from the end.

        Raises:
            IndexError: There is no such sample.
            TypeError: The index is no whole number; slices are not supported.
            InputFileError: The sample is damaged.
        """
        if isinstance(index, slice):
            raise TypeError("expected a whole number as index of a sample, found a slice; index in a loop instead")
        place = whole_number(index)
        place += len(self) if place < 0 else 0
        if not 0 <= place < len(self):
            raise IndexError(f"expected an index of {len(self)} samples, found {index}")
        shard = bisect_right(self._ends, place)
        before = self._ends[shard - 1] if shard else 0
        return self._readers[shard].read(place - before, self.layers)
