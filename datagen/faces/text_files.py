"""The list of samples that a command rejected, a file beside what it makes."""

import json
from collections.abc import Iterable
from pathlib import Path

from pix2face.files.writing import written_in_one_step

REJECTED_FILE = "rejected.jsonl"


def write_rejected(folder: Path, rejected: Iterable[tuple[str, str]]) -> None:
    """Lists samples that could not be used: id and reason of each, one JSON object a line."""
    lines = (json.dumps({"sample_id": sample_id, "reason": reason}) for sample_id, reason in rejected)
    with written_in_one_step(folder / REJECTED_FILE) as temporary:
        temporary.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
