"""The files of a training set: any sample at any time, with few of them open."""

import os
from collections import OrderedDict, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import final

from pix2face.errors import InputFileError
from pix2face.shards.sample_spans import ShardSpans, StoredSample
from pix2face.shards.shard_reader import ShardReader

# Opening a file takes 10 microseconds, opening it with the HDF5 library some milliseconds and a megabyte.
MOST_OPEN_FILES, MOST_OPEN_READERS = 128, 32


@final
class SampleFiles:
    """Reads samples by shard and position. Belongs to one process.

    Args:
        paths: The shards.
        spans: For each where its samples stand; None where it must be read with the HDF5 library.
        layers: What is wanted of each sample; those that a shard lacks are left out.
    """

    def __init__(self, paths: Sequence[Path], spans: Sequence[ShardSpans | None], layers: Sequence[str]) -> None:
        self._paths = paths
        self._spans = spans
        self._layers = layers
        self._files: OrderedDict[int, int] = OrderedDict()
        self._readers: OrderedDict[int, ShardReader] = OrderedDict()
        self._checked: defaultdict[int, set[int]] = defaultdict(set)

    def read(self, shard: int, position: int) -> StoredSample:
        """One sample; its checksum is compared when it is read for the first time.

        Raises:
            InputFileError: It is damaged, or its shard cannot be read.
        """
        is_checked = position not in self._checked[shard]
        try:
            spans = self._spans[shard]
            if spans is None:
                found = self._read_by_hdf5(shard, position, is_checked)
            else:
                layers = [name for name in self._layers if name in spans.layers]
                found = spans.sample(
                    position,
                    layers,
                    lambda start, n_bytes: os.pread(self._file(shard), n_bytes, start),
                    is_checked=is_checked,
                )
        except (ValueError, OSError) as error:
            raise self.damaged(shard, position, str(error)) from error
        self._checked[shard].add(position)
        return found

    def damaged(self, shard: int, position: int, what: str) -> InputFileError:
        """The error that names a sample."""
        path = self._paths[shard]
        try:
            with ShardReader(path) as reader:
                name = f"sample {reader.sample_ids[position]!r}"
        except (InputFileError, IndexError):
            name = f"sample number {position}"
        return InputFileError(
            f"{path}: {name} is damaged ({what}); `datagen verify {path.parent}` lists all damage: delete the shards "
            "that it names and run `datagen render` again, it writes what is missing"
        )

    def close(self) -> None:
        """Closes all files; reading afterwards opens them again."""
        while self._files:
            os.close(self._files.popitem()[1])
        while self._readers:
            self._readers.popitem()[1].close()

    def _file(self, shard: int) -> int:
        if shard not in self._files:
            if len(self._files) >= MOST_OPEN_FILES:
                os.close(self._files.popitem(last=False)[1])
            self._files[shard] = os.open(self._paths[shard], os.O_RDONLY)
        self._files.move_to_end(shard)
        return self._files[shard]

    def _read_by_hdf5(self, shard: int, position: int, is_checked: bool) -> StoredSample:
        reader = self._reader(shard)
        if is_checked and len(set(reader.checksum_pair(position))) > 1:
            raise ValueError("the checksum differs: the content has changed since it was written")
        top, left, bottom, right = reader.box_px(position)
        layers = [name for name in self._layers if name in reader.header.layers]
        steps = {name: reader.stored_layer(position, name)[top:bottom, left:right] for name in layers}
        return StoredSample(reader.image_bytes(position), steps, (left, top), reader.landmarks2d(position))

    def _reader(self, shard: int) -> ShardReader:
        if shard not in self._readers:
            if len(self._readers) >= MOST_OPEN_READERS:
                self._readers.popitem(last=False)[1].close()
            self._readers[shard] = ShardReader(self._paths[shard])
        self._readers.move_to_end(shard)
        return self._readers[shard]
