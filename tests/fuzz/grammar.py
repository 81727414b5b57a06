"""A reader with the grammar of its files."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True)
class Grammar:
    """How files of one kind are made, and who reads them."""

    write: Callable[[Path, np.random.Generator], object]  # one file, drawn from the grammar
    read: Callable[[Path], object]
    suffix: str
