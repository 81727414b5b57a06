"""The configuration of synthetic photographs as TOML, with one table for each part, and three presets.

To add an ingredient, add a field to the configuration of its part, with a comment beside or above it, which `datagen
appearance` prints. To add a part, add a field here and in `appearance.Appearance`.
"""

import hashlib
import inspect
import json
import re
import textwrap
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar, final

from datagen.appearance.accessories.accessories_config import HARD_ACCESSORIES, AccessoriesConfig
from datagen.appearance.backdrop.backdrop_config import HARD_BACKDROP, BackdropConfig
from datagen.appearance.hair.hair_config import HARD_HAIR, HairConfig
from datagen.appearance.light.light_config import HARD_LIGHT, LightConfig
from datagen.appearance.photograph.photograph_config import HARD_PHOTOGRAPH, PhotographConfig
from datagen.appearance.skin.skin_config import HARD_SKIN, SkinConfig
from datagen.sampling.sampling_config import HARD_GEOMETRY, PLAIN_GEOMETRY, GeometryConfig
from pix2face.errors import InputFileError, UsageError
from pix2face.files.opening import is_regular, read_text_file

DEFAULT, HARD, PLAIN = "default", "hard", "plain"
LARGEST_FILE_BYTES = 1 << 20
LARGEST_INTEGER = 2**63 - 1  # of TOML


@final
@dataclass(frozen=True, kw_only=True)
class AppearanceConfig:
    """Distributions of synthetic photographs."""

    # The preset that this configuration starts from. `plain` draws heads without hair, clothes and surroundings,
    # painted region by region; only the table `geometry` counts then. Models other than the built-in one need `plain`.
    preset: str = DEFAULT
    # Poses, cameras, crops and expressions, drawn by `datagen sample`. The other tables are drawn by `datagen render`.
    geometry: GeometryConfig = field(default_factory=GeometryConfig)
    skin: SkinConfig = field(default_factory=SkinConfig)  # Skin, eyes, mouth and make-up.
    hair: HairConfig = field(default_factory=HairConfig)  # Hair, brows and lashes.
    # Glasses, beards, hats, clothes, hands and other things in front of a face.
    accessories: AccessoriesConfig = field(default_factory=AccessoriesConfig)
    light: LightConfig = field(default_factory=LightConfig)  # Environments, lamps and shadows.
    backdrop: BackdropConfig = field(default_factory=BackdropConfig)  # What is behind the head.
    photograph: PhotographConfig = field(default_factory=PhotographConfig)  # Lens, sensor, processing, border and file.

    def check(self) -> None:
        """Raises a `UsageError` that names the first field with a number that nothing can be drawn from."""
        for part in _parts(self):
            getattr(self, part).check()

    @property
    def is_plain(self) -> bool:
        """Whether only heads are drawn."""
        return self.preset == PLAIN

    def described(self) -> dict[str, Any]:
        """Returns what shards store: the preset, the values that differ from it, and a hash of all values."""
        if self.is_plain:
            return {"appearance": PLAIN}
        base = PRESETS[self.preset]
        changed = {
            f"appearance.{part}.{name}": value
            for part in _parts(self)
            for name, value in asdict(getattr(self, part)).items()
            if value != getattr(getattr(base, part), name)
        }
        digest = hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()
        return {"appearance": self.preset, "appearance_sha256": digest, **changed}


def _parts(config: AppearanceConfig) -> list[str]:
    return [part.name for part in fields(config) if part.name != "preset"]


PRESETS: Mapping[str, AppearanceConfig] = MappingProxyType(
    {
        PLAIN: AppearanceConfig(preset=PLAIN, geometry=PLAIN_GEOMETRY),
        DEFAULT: AppearanceConfig(),
        HARD: AppearanceConfig(
            preset=HARD,
            geometry=HARD_GEOMETRY,
            skin=HARD_SKIN,
            hair=HARD_HAIR,
            accessories=HARD_ACCESSORIES,
            light=HARD_LIGHT,
            backdrop=HARD_BACKDROP,
            photograph=HARD_PHOTOGRAPH,
        ),
    }
)


def load_configuration(name: str) -> AppearanceConfig:
    """Loads the configuration of a preset or of a TOML file.

    Args:
        name: `plain`, `default`, `hard`, or the path of a file with tables as `datagen appearance` prints them. Missing
            values come from the preset that the file names (`preset = "hard"`), or from `default`.

    Raises:
        UsageError: There is no such preset or file, or a number is outside its limits.
        InputFileError: The file is not valid TOML, or has an unknown name or a value of the wrong kind.
    """
    if name in PRESETS:
        return PRESETS[name]
    path = Path(name)
    if not is_regular(path):
        raise UsageError(
            f"--appearance: expected {', '.join(PRESETS)} or a TOML file, found {name!r}; `datagen appearance` prints "
            "one to start from"
        )
    given = _read_toml(path)
    base = given.get("preset", DEFAULT)
    if base not in list(PRESETS):  # a list, since the value in a file may be unhashable
        raise UsageError(f"{path}: preset: expected {', '.join(PRESETS)}, found {base!r}")
    configuration = _replaced(PRESETS[base], given, str(path))
    try:
        configuration.check()
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error
    return configuration


T = TypeVar("T")

# A field of a dataclass with the comments above and beside it.
_FIELD = re.compile(r"((?:^    # .*\n)*)^    (\w+): [^#\n]*(?:# (.*))?$", re.MULTILINE)


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_text_file(path, "a TOML file", LARGEST_FILE_BYTES))
    except (ValueError, RecursionError) as error:
        raise InputFileError(f"{path}: expected a TOML file, found one that cannot be read ({error})") from error


def _replaced(base: T, given: Mapping[str, Any], where: str, table: str = "") -> T:
    """Replaces fields of a configuration; `where` and `table` name the file and the table in messages."""
    known = {field.name: getattr(base, field.name) for field in fields(base)}  # type: ignore[arg-type]
    unknown = sorted(given.keys() - known.keys())
    if unknown:
        raise InputFileError(f"{where}: {table}{unknown[0]}: expected one of {', '.join(known)}, found {unknown[0]!r}")
    changed = {name: _value(known[name], value, where, table + name) for name, value in given.items()}
    return replace(base, **changed)  # type: ignore[type-var]


def to_toml(configuration: Any, table: str = "") -> str:
    """Formats a configuration as TOML, with the comment of each field in the line above it."""
    described = _descriptions(type(configuration))
    lines, tables = [f"[{table}]"] if table else [], []
    for option in fields(configuration):
        value = getattr(configuration, option.name)
        if is_dataclass(value):
            tables.append(to_toml(value, f"{table}.{option.name}".lstrip(".")))
            continue
        lines += textwrap.wrap(described[option.name], 100, initial_indent="# ", subsequent_indent="# ")
        lines.append(f"{option.name} = {_toml_value(value)}")
    return "\n".join(["\n".join(lines) + "\n", *tables])


def _value(old: Any, new: Any, where: str, option: str) -> Any:
    if isinstance(new, int) and abs(new) > LARGEST_INTEGER:
        raise InputFileError(
            f"{where}: {option}: expected {_kind(old)}, found a whole number of {len(str(new))} digits"
        )
    if is_dataclass(old):
        if not isinstance(new, dict):
            raise InputFileError(f"{where}: {option}: expected a table, found {new!r}")
        return _replaced(old, new, where, f"{option}.")
    if isinstance(old, tuple) and isinstance(new, list):
        if old and len(old) != len(new):
            raise InputFileError(f"{where}: {option}: expected {len(old)} values, found {new}")
        return tuple(_value(*pair, where, option) for pair in zip(old, new, strict=True)) if old else tuple(new)
    if isinstance(old, float) and isinstance(new, int) and not isinstance(new, bool):
        return float(new)
    if type(old) is not type(new):
        raise InputFileError(f"{where}: {option}: expected {_kind(old)} such as {old!r}, found {new!r}")
    return new


def _kind(value: Any) -> str:
    return {bool: "true or false", int: "a whole number", float: "a number", str: "a text", tuple: "a list"}.get(
        type(value), type(value).__name__
    )


def _toml_value(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml_value, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    return repr(value)


def _descriptions(kind: type) -> dict[str, str]:
    fields_of_kind = _FIELD.findall(inspect.getsource(kind))
    return {name: " ".join((above.replace("    # ", "") + beside).split()) for above, name, beside in fields_of_kind}
