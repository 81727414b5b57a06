"""The card of a set of shards: what it holds, where that comes from, what may be passed on, and how to read it.

A card is written from the shards alone and holds neither times nor places: the same shards have the same card.
"""

import json
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from string import Template
from typing import final

from datagen.inspection.statistics_tables import own_file
from pix2face.command_line import REJECTED_FILE, counted, printable
from pix2face.errors import UsageError
from pix2face.files.checked_hdf5 import open_unchecked
from pix2face.models.morphable_model import builtin_model
from pix2face.shards.layers import IMAGE, LANDMARKS, LAYERS
from pix2face.shards.sample import PICTURE, PictureKind
from pix2face.shards.shard_layout import has_foreign_filter, is_predicted, open_datasets
from pix2face.shards.shard_reader import ShardHeader, ShardReader, shard_paths

CARD_FILE = "dataset_card.md"
N_KINDS_SHOWN = 20
_NOT_RECORDED = "not recorded"
_OTHER_LAYERS = {
    IMAGE: "JPEG or PNG files, unchanged; the first `image_length` bytes of each row are the file",
    LANDMARKS: "the 68 iBUG points in px and in mm, and which of them are visible",
}


@final
@dataclass(kw_only=True)
class DatasetSummary:
    """What a card is written from."""

    header: ShardHeader  # shared by all shards, without the rejected samples
    n_shards: int
    n_bytes: int
    n_rejected: int = 0
    sizes: Counter[str] = field(default_factory=Counter)
    pictures: Counter[str] = field(default_factory=Counter)  # of each PictureKind
    geometries: Counter[str] = field(default_factory=Counter)
    n_own_backdrops: int = 0  # pictures with a picture of the user's own behind the face
    hdf5_example: str = ""

    @property
    def n_rendered(self) -> int:
        """Number of rendered pictures."""
        return sum(self.pictures[kind] for kind in (PictureKind.SYNTHETIC, PictureKind.PLAIN)) * self._has_pictures

    @property
    def n_photographs(self) -> int:
        """Number of pictures that were not rendered. One of unknown origin counts as a photograph."""
        return (self.pictures.total() - self.n_rendered) * self._has_pictures

    @property
    def _has_pictures(self) -> bool:
        return IMAGE in self.header.layers


def summarise(folder: Path) -> DatasetSummary:
    """Reads headers, sizes and attributes of all shards; no picture is decoded.

    Raises:
        UsageError: There are no shards, or they belong to several jobs.
        InputFileError: A shard cannot be read.
    """
    paths = shard_paths(folder)
    header = replace(ShardReader(paths[0]).header, rejected="[]")
    summary = DatasetSummary(
        header=header,
        n_shards=len(paths),
        n_bytes=sum(path.stat().st_size for path in paths),
        hdf5_example=_hdf5_example(paths[0], header),
    )
    for path in paths:
        reader = ShardReader(path)
        if replace(reader.header, rejected="[]") != header:
            raise UsageError(
                f"{folder}: expected shards of one job, found that {paths[0].name} and {path.name} differ in "
                "model, layers or configuration; give each job a folder of its own"
            )
        summary.n_rejected += len(reader.header.rejected_samples)
        for index, attributes in enumerate(reader.attributes()):
            height, width = reader.size_px(index)
            summary.sizes[f"{width} x {height} px" if height else "unknown"] += 1
            summary.pictures[str(attributes.get(PICTURE, _NOT_RECORDED))] += 1
            summary.geometries[str(attributes.get("geometry", _NOT_RECORDED))] += 1
            if IMAGE in header.layers:
                summary.n_own_backdrops += bool(attributes.get("backdrop.file"))  # "" for every other backdrop
    return summary


def dataset_card(summary: DatasetSummary) -> str:
    """Writes the card as Markdown. Texts that come from files are quoted, so that they cannot act as markup."""
    header, n_rejected = summary.header, summary.n_rejected
    rejected = f" {counted(n_rejected, 'sample')} could not be used: see {REJECTED_FILE}." if n_rejected else ""
    example = summary.hdf5_example
    texts = {
        "size": f"{counted(summary.sizes.total(), 'sample')} in {counted(summary.n_shards, 'shard')}, "
        f"{summary.n_bytes / 1e6:.1f} MB",
        "generator": _quoted(header.generator),
        "rejected": rejected,
        "layers": _layer_table(header),
        "model": _quoted(header.model_name),
        "sha256": _quoted(header.model_sha256),
        "regions": ", ".join(map(_quoted, header.region_names)) or "none",
        "sizes": _kinds(summary.sizes),
        "pictures": _kinds(summary.pictures),
        "geometries": _kinds(summary.geometries),
        "licence": _quoted(header.licence),
        "terms": "\n".join(f"- {line}" for line in terms(summary)),
        "example": f"To read one layer without the package:\n\n{_block(example, 'python')}\n\n" if example else "",
        "configuration": _block(json.dumps(json.loads(header.configuration), indent=2, sort_keys=True), "json"),
    }
    return Template(own_file("dataset_card.md")).substitute(texts)


def terms(summary: DatasetSummary) -> list[str]:
    """Says what may be passed on, one sentence or two a line. A picture of unknown origin counts as a photograph."""
    header, builtin = summary.header, builtin_model()
    n_rendered, n_photographs, n_own = summary.n_rendered, summary.n_photographs, summary.n_own_backdrops
    lines = []
    if n_photographs:
        lines.append(
            f"**Photographs ({n_photographs}): not to be passed on** unless the terms of their source allow it. Those "
            "of 300W-LP and AFLW2000-3D are for research only. The shards contain the original bytes of photographs."
        )
    if n_own:
        lines.append(
            f"**Rendered pictures with a picture of your own behind the face ({n_own}): not to be passed on** unless "
            "the terms of that picture allow it."
        )
    if header.model_sha256 != builtin.sha256:
        lines.append(
            f"**Maps, coefficients, landmarks and renders of {_quoted(header.model_name)}: not to be passed on** "
            "unless its terms (above) allow it. PNCC is the mean face of the model, and the offsets span its bases. "
            "Maps made with the Basel Face Model must therefore not be passed on, like the model itself."
        )
    else:
        is_fitted = n_photographs > 0 or PictureKind.PHOTOGRAPH in summary.pictures
        is_free = header.licence == builtin.licence and not is_fitted
        also = "" if is_free else "; what was fitted to photographs or annotations is bound by their terms as well"
        lines.append(f"Maps, coefficients and landmarks: the built-in model is under {builtin.licence}{also}.")
        if n_rendered > n_own:
            lines.append(f"Rendered pictures ({n_rendered - n_own}): {builtin.licence}, like the built-in model.")
    lines.append("A network trained on this set is bound by the same terms; checkpoints carry them in their header.")
    return lines


def _hdf5_example(path: Path, header: ShardHeader) -> str:
    layer = next((layer for name, layer in LAYERS.items() if name in header.layers), None)
    if layer is None:
        return ""
    with open_unchecked(path) as file:
        dataset = open_datasets(file, path)[layer.name]
        name, is_planar, needs_plugin = dataset.name[1:], is_predicted(dataset), has_foreign_filter(dataset)
    imports = "import h5py, hdf5plugin  # pip install hdf5plugin" if needs_plugin else "import h5py"
    lines = [imports, 'with h5py.File("shard-00000.h5") as file:', f'    values = file["{name}"][0]']
    if is_planar:  # Stored is each value less its prediction from its neighbours, with the sign in the lowest bit.
        kind = f"i{layer.stored.itemsize}"
        lines.append(
            f'    values = ((values >> 1) ^ -(values & 1)).view("{kind}").cumsum(0, "{kind}").cumsum(1, "{kind}")'
        )
    unit = f"  # {layer.unit}" if layer.unit else ""
    return "\n".join([*lines, f'    values = values / file["{name}"].attrs["steps_per_unit"]{unit}'])


def _layer_table(header: ShardHeader) -> str:
    lines = ["| layer | values a pixel | unit | meaning |", "| --- | --- | --- | --- |"]
    for name in header.layers:
        if name in LAYERS:
            layer = LAYERS[name]
            lines.append(f"| `{name}` | {layer.n_channels} | {layer.unit or '-'} | {layer.meaning} |")
        else:
            lines.append(f"| `{name}` | - | - | {_OTHER_LAYERS[name]} |")
    return "\n".join(lines)


def _kinds(counts: Mapping[str, int]) -> str:
    ordered = sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    shown, rest = ordered[:N_KINDS_SHOWN], ordered[N_KINDS_SHOWN:]
    texts = [f"{_quoted(value)} {n}" for value, n in shown]
    if rest:
        texts.append(f"{len(rest)} others {sum(n for _, n in rest)}")
    return ", ".join(texts) or "none"


def _quoted(text: str) -> str:
    """A text as inline code, whatever Markdown, HTML or a terminal would make of it."""
    shown = printable(text)
    fence = "`" * (_longest_run(shown) + 1)
    return f"{fence} {shown} {fence}" if "`" in shown else f"{fence}{shown or ' '}{fence}"


def _block(text: str, language: str) -> str:
    fence = "`" * max(3, _longest_run(text) + 1)
    shown = "\n".join(map(printable, text.split("\n")))
    return f"{fence}{language}\n{shown}\n{fence}"


def _longest_run(text: str) -> int:
    """The length of the longest run of backticks."""
    return max(map(len, re.findall("`+", text)), default=0)
