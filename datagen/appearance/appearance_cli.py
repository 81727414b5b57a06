"""The command ``datagen appearance``."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from datagen.appearance.appearance_config import load_configuration, to_toml


@dataclass(frozen=True)
class ShowConfig:
    """Configuration of ``datagen appearance``."""

    appearance: Annotated[str, tyro.conf.Positional] = "default"
    """``plain``, ``default``, ``hard``, or a TOML file."""


def appearance(config: Annotated[ShowConfig, tyro.conf.arg(name="")]) -> int:
    """Print what synthetic photographs are drawn from: every number, with what it means, as TOML.

    Change what it prints and give the file to `datagen sample` and `datagen render` as --appearance. Lines may be left
    out: the values of `preset` hold then.
    """
    print(to_toml(load_configuration(config.appearance)), end="")
    return 0
