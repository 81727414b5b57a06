"""The description of a set of shards in Croissant 1.1, the JSON-LD that dataset search engines read.

It says the same as the card, for programs. What never changes is in ``pages/croissant.json``. Like the card, it holds
neither times nor places.

Source: MLCommons, Croissant Format Specification 1.1, and its Responsible AI extension (properties ``rai:``).
"""

import json
from pathlib import Path

from datagen.inspection.dataset_card import CARD_FILE, DatasetSummary, dataset_card, summarise, terms
from datagen.inspection.statistics_tables import own_file
from pix2face.command_line import counted, printable
from pix2face.files.writing import write_file
from pix2face.shards.layers import IMAGE

CROISSANT_FILE = "croissant.json"


def write_descriptions(folder: Path) -> tuple[Path, Path]:
    """Writes the card and the Croissant description of a folder of shards into it, and returns their paths.

    Each file is written whole or not at all.

    Raises:
        UsageError: There are no shards, or they belong to several jobs.
        InputFileError: A shard cannot be read.
    """
    summary = summarise(folder)
    card, description = folder / CARD_FILE, folder / CROISSANT_FILE
    for path, text in ((card, dataset_card(summary)), (description, croissant(summary))):
        write_file(path, text)
    return card, description


def croissant(summary: DatasetSummary) -> str:
    """The description as JSON."""
    header = summary.header
    fields = json.loads(own_file(CROISSANT_FILE)) | {
        "description": printable(
            f"{counted(summary.sizes.total(), 'sample')} with the layers {', '.join(header.layers)}, for the "
            f"morphable model {header.model_name}, made by {header.generator}"
        ),
        "license": printable(header.licence),
        "rai:dataCollection": _collection(summary),
        "rai:personalSensitiveInformation": _who_is_shown(summary),
        "rai:dataReleaseMaintenancePlan": " ".join(terms(summary)),
        "rai:machineAnnotationTools": printable(header.generator),
    }
    return json.dumps(fields, indent=1) + "\n"


def _collection(summary: DatasetSummary) -> str:
    if IMAGE not in summary.header.layers:
        return "There are no pictures, only maps."
    return (
        f"{counted(summary.n_rendered, 'picture')} synthetic: rendered from random faces of the morphable model. "
        f"{counted(summary.n_photographs, 'photograph')}."
    )


def _who_is_shown(summary: DatasetSummary) -> str:
    shown = []
    if summary.n_photographs:
        shown.append(f"{counted(summary.n_photographs, 'photograph')} with faces of people.")
    if summary.n_own_backdrops:
        own = counted(summary.n_own_backdrops, "rendered picture")
        shown.append(f"{own} with a picture of the user's own behind the face, which may show people.")
    return " ".join(shown) or "None: no picture shows a person who exists."
