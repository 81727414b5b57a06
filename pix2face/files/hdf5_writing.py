"""Lets HDF5 files be written to a disk that may be full.

Where a write fails, the HDF5 library goes on with half-made structures: it prints tracebacks while objects are closed,
and can end the process. So it is given a file whose writes never fail, and the failure is raised beside it.
"""

from collections.abc import Callable
from io import FileIO
from pathlib import Path
from typing import Any, final


@final
class UnfailingFile(FileIO):
    """A new file for ``h5py.File(..., "w")``, which it is a context manager around.

    From the first failed write on, nothing more is written. That failure is raised when the block ends, and by
    ``check``.

    Raises:
        OSError: The file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self._error: OSError | None = None

    def __exit__(self, *error: object) -> None:
        self.close()
        self.check()

    def check(self) -> None:
        """Raises the failure of an earlier write, so that long work for nothing can end.

        Raises:
            OSError: A write failed.
        """
        if self._error is not None:
            raise self._error

    def write(self, content: Any, /) -> int:
        """Writes where the file stands."""
        self._try(lambda: self._write_whole(memoryview(content)))
        return len(content)

    def truncate(self, size: int | None = None, /) -> int:
        """Cuts or extends the file."""
        self._try(lambda: FileIO.truncate(self, size))
        return self.tell() if size is None else size

    def _write_whole(self, content: memoryview) -> None:
        while content:  # a write stops short where the disk is nearly full
            content = content[super().write(content) :]

    def _try(self, change: Callable[[], object]) -> None:
        if self._error is None:
            try:
                change()
            except OSError as error:
                self._error = error
