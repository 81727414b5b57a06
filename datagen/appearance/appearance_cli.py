"""The command `datagen appearance`."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from datagen.appearance.appearance_config import load_configuration, to_toml


@dataclass(frozen=True)
class ShowConfig:
    """Options of `datagen appearance`.

    Attributes:
        appearance: `plain`, `default`, `hard`, or a TOML file.
    """

    appearance: Annotated[str, tyro.conf.Positional] = "default"


def appearance(config: Annotated[ShowConfig, tyro.conf.arg(name="")]) -> int:
    """Print the configuration of synthetic photographs as TOML, with an explanation of every setting.

    Edit the output and pass the file to `datagen sample` and `datagen render` as --appearance. You may delete lines;
    their values then come from the preset.
    """
    print(to_toml(load_configuration(config.appearance)), end="")
    return 0
