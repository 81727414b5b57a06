"""Small text files beside what a command makes, whole or not at all: the list of what was rejected, the card."""

import json
from collections.abc import Iterable
from pathlib import Path

REJECTED_FILE = "rejected.jsonl"


def write_rejected(folder: Path, rejected: Iterable[tuple[str, str]]) -> None:
    """Lists samples that could not be used: id and reason of each, one JSON object a line."""
    lines = (json.dumps({"sample_id": sample_id, "reason": reason}) for sample_id, reason in rejected)
    write_whole(folder / REJECTED_FILE, "".join(f"{line}\n" for line in lines))


def write_whole(path: Path, content: str) -> None:
    """Writes a file, whole or not at all; one of the same name is replaced."""
    temporary = path.with_name(f".{path.name}.part")
    try:
        temporary.write_text(content, encoding="utf-8")
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
