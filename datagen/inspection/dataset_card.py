"""The card of a set of shards: what is in it, where it comes from, what may not be passed on, how to read it.

It follows from the shards alone and holds neither times nor places: the same shards have the same card.
"""

import json
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final

import h5py

from datagen.faces.text_files import write_whole
from pix2face.command_line import counted
from pix2face.errors import UsageError
from pix2face.models.morphable_model import builtin_model
from pix2face.shards.compressions import has_foreign_filter
from pix2face.shards.layers import IMAGE, LANDMARKS, LAYERS
from pix2face.shards.shard_layout import is_predicted
from pix2face.shards.shard_reader import ShardHeader, ShardReader, shard_paths

CARD_FILE = "dataset_card.md"
# Attributes that say where something comes from.
ORIGINS = ("picture", "geometry")
N_KINDS_SHOWN = 20
_OTHERS = {
    IMAGE: "JPEG or PNG files as they are (`image_bytes`, `image_end`)",
    LANDMARKS: "68 points of iBUG in px and in mm, and which of them are seen",
}


@final
@dataclass(frozen=True)
class DatasetSummary:
    """What a card is written from.

    Attributes:
        header: Of every shard, without what was rejected.
        n_samples: In all shards.
        n_shards: Their number.
        n_bytes: Of all shards.
        n_rejected: Samples that could not be used.
        picture_sizes: Samples of each size, "width x height px".
        origins: For the attributes that say where something comes from, how often each value occurs.
        example: A stored layer to show reading by; None without layers.
    """

    header: ShardHeader
    n_samples: int
    n_shards: int
    n_bytes: int
    n_rejected: int
    picture_sizes: dict[str, int]
    origins: dict[str, dict[str, int]]
    example: "StoredLayer | None"


@final
@dataclass(frozen=True)
class StoredLayer:
    """How a layer stands in its file.

    Attributes:
        name: Of the layer.
        dtype: Of its values in steps.
        is_planar: It holds what the predictor leaves.
        needs_plugin: No HDF5 library reads it without hdf5plugin.
    """

    name: str
    dtype: str
    is_planar: bool
    needs_plugin: bool


def write_card(folder: Path) -> Path:
    """Writes the card of a folder of shards into it, whole or not at all.

    Returns:
        Its path.

    Raises:
        UsageError: There are no shards, or shards of several jobs.
        InputFileError: A shard cannot be read.
    """
    path = folder / CARD_FILE
    write_whole(path, dataset_card(summarise(folder)))
    return path


def summarise(folder: Path) -> DatasetSummary:
    """Reads what a card needs: headers, sizes and attributes, no pixel.

    Raises:
        UsageError: There are no shards, or shards of several jobs.
        InputFileError: A shard cannot be read.
    """
    paths = shard_paths(folder)
    headers: dict[ShardHeader, Path] = {}
    sizes, origins = Counter[str](), {name: Counter[str]() for name in ORIGINS}
    n_samples = n_rejected = 0
    for path in paths:
        with ShardReader(path) as reader:
            headers.setdefault(replace(reader.header, rejected="[]"), path)
            n_samples += len(reader)
            n_rejected += len(json.loads(reader.header.rejected))
            for index, attributes in enumerate(reader.attributes()):
                height, width = reader.size_px(index)
                sizes[f"{width} x {height} px" if height else "unknown"] += 1
                for name in ORIGINS:
                    origins[name][str(attributes.get(name, "not recorded"))] += 1
    if len(headers) > 1:
        first, second = list(headers.values())[:2]
        raise UsageError(
            f"{folder}: expected shards of one job, found that {first.name} and {second.name} differ in model, layers "
            "or configuration; give each job a folder of its own"
        )
    header = next(iter(headers))
    return DatasetSummary(
        header=header,
        n_samples=n_samples,
        n_shards=len(paths),
        n_bytes=sum(path.stat().st_size for path in paths),
        n_rejected=n_rejected,
        picture_sizes=dict(sorted(sizes.items(), key=lambda item: (-item[1], item[0]))),
        origins={
            name: dict(sorted(found.items(), key=lambda item: (-item[1], item[0]))) for name, found in origins.items()
        },
        example=_first_layer(paths[0], header),
    )


def dataset_card(summary: DatasetSummary) -> str:
    """The card, in Markdown; every text that came out of a file is shown as it stands."""
    header, n_rejected = summary.header, summary.n_rejected
    rejected = f" {counted(n_rejected, 'sample')} more could not be used: see rejected.jsonl." if n_rejected else ""
    parts = [
        "# Faces with dense ground truth",
        f"{counted(summary.n_samples, 'sample')} in {counted(summary.n_shards, 'shard')}, "
        f"{summary.n_bytes / 1e6:.1f} MB, made by {_code(header.generator)}.{rejected}",
        "## What a sample holds",
        _layer_table(header),
        "Beside these: camera (4 x 4), identity and expression coefficients in standard deviations, attributes.",
        f"Morphable model: {_code(header.model_name)}, SHA-256 {_code(header.model_sha256)}. Regions: "
        f"{', '.join(map(_code, header.region_names)) or 'none'}.",
        "Sizes: " + _kinds(summary.picture_sizes),
        "## Sources",
        "\n".join(f"- {name}: {_kinds(found)}" for name, found in summary.origins.items()),
        f"Terms, as the source states them: {_code(header.licence)}",
        "## What may be passed on",
        "\n".join(f"- {line}" for line in terms(summary)),
        "## How to read it",
        f"With the package:\n\n{_block(package_example(), 'python')}",
    ]
    example = hdf5_example(summary)
    if example:
        parts.append(f"Without it, of one layer:\n\n{_block(example, 'python')}")
    parts += ["## Configuration", _block(_pretty(header.configuration), "json")]
    return "\n\n".join(parts) + "\n"


def terms(summary: DatasetSummary) -> list[str]:
    """What may be passed on and what not, in words; where nothing is known, it may not."""
    header, builtin = summary.header, builtin_model()
    pictures = summary.origins["picture"] if IMAGE in header.layers else {}
    n_photographs = sum(n for kind, n in pictures.items() if kind != "rendered")
    lines = []
    if n_photographs:
        lines.append(
            f"**Photographs ({n_photographs}): not to be passed on** unless the terms of their source allow it. Those "
            "of 300W-LP and AFLW2000-3D are for research only, and the shards hold their very bytes."
        )
    if header.model_sha256 != builtin.sha256:
        lines.append(
            f"**Maps, coefficients, landmarks and renders of {_code(header.model_name)}: not to be passed on** unless "
            "its terms (above) allow it. PNCC is the model's mean face itself and the offsets span its bases: maps "
            "made with the Basel Face Model are bound like the model, which is not passed on."
        )
    else:
        is_free = header.licence == builtin.licence and not n_photographs
        also = (
            "" if is_free else "; what was fitted to photographs or annotations is bound by the terms of those as well"
        )
        lines.append(f"Maps, coefficients and landmarks: the built-in model is under {builtin.licence}{also}.")
        if "rendered" in pictures:
            lines.append(f"Rendered pictures ({pictures['rendered']}): {builtin.licence}, like the built-in model.")
    lines.append("A network trained on this is bound by the same terms; checkpoints carry them in their header.")
    return lines


def package_example() -> str:
    """Three lines that read a sample with the package."""
    return (
        "from pathlib import Path\n"
        "from pix2face.shards.shard_reader import ShardReader\n"
        'with ShardReader(Path("shard-00000.h5")) as reader: triplet = reader.triplet(0)  # .image, .layers, .camera'
    )


def hdf5_example(summary: DatasetSummary) -> str:
    """Five lines that read a layer with h5py; "" without layers."""
    layer = summary.example
    if layer is None:
        return ""
    name, kind = layer.name, layer.dtype
    imports = "import h5py, hdf5plugin  # pip install hdf5plugin" if layer.needs_plugin else "import h5py"
    lines = [imports, 'with h5py.File("shard-00000.h5") as file:', f'    values = file["{name}"][0]']
    if layer.is_planar:  # the predictor leaves each value less its neighbours, the sign in the lowest bit
        lines.append(
            f'    values = ((values >> 1) ^ -(values & 1)).view("{kind}").cumsum(0, "{kind}").cumsum(1, "{kind}")'
        )
    unit = LAYERS[name].unit
    named = f"  # {unit}" if unit else ""
    lines.append(f'    values = values / file["{name}"].attrs["steps_per_unit"]{named}')
    return "\n".join(lines)


def _first_layer(path: Path, header: ShardHeader) -> StoredLayer | None:
    name = next((name for name in LAYERS if name in header.layers), None)
    if name is None:
        return None
    with h5py.File(path, "r") as file:
        dtype = f"i{LAYERS[name].stored.itemsize}"
        return StoredLayer(name, dtype, is_predicted(file[name]), has_foreign_filter(file[name]))


def _layer_table(header: ShardHeader) -> str:
    lines = ["| layer | values a pixel | unit | meaning |", "| --- | --- | --- | --- |"]
    for name in header.layers:
        if name in LAYERS:
            layer = LAYERS[name]
            lines.append(f"| `{name}` | {layer.n_channels} | {layer.unit or '-'} | {layer.meaning} |")
        else:
            lines.append(f"| `{name}` | - | - | {_OTHERS[name]} |")
    return "\n".join(lines)


def _kinds(counts: dict[str, int]) -> str:
    shown = [f"{_code(value)} {n}" for value, n in list(counts.items())[:N_KINDS_SHOWN]]
    rest = list(counts.values())[N_KINDS_SHOWN:]
    return ", ".join([*shown, f"{len(rest)} others {sum(rest)}"] if rest else shown) or "none"


def _pretty(configuration: str) -> str:
    try:
        parsed: Any = json.loads(configuration)
    except ValueError:
        return configuration
    return json.dumps(parsed, indent=2, sort_keys=True)


def _code(text: str) -> str:
    """A text as it stands, whatever Markdown, HTML or a terminal would make of it."""
    shown = _visible(text).replace("\n", "\\n")
    fence = "`" * (_longest_run(shown) + 1)
    return f"{fence} {shown} {fence}" if "`" in shown else f"{fence}{shown or ' '}{fence}"


def _block(text: str, language: str) -> str:
    fence = "`" * max(3, _longest_run(text) + 1)
    return f"{fence}{language}\n{_visible(text)}\n{fence}"


def _visible(text: str) -> str:
    return "".join(
        character if character.isprintable() or character == "\n" else character.encode("unicode_escape").decode()
        for character in text
    )


def _longest_run(text: str) -> int:
    """Of backticks."""
    longest = run = 0
    for character in text:
        run = run + 1 if character == "`" else 0
        longest = max(longest, run)
    return longest
