"""What every benchmark shares: what its figures were measured on, and how they are given out."""

import json
import os
import platform
import sys
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("numpy", "scipy", "h5py", "torch", "onnxruntime")


def surroundings() -> dict[str, object]:
    """Processor, cores, and versions of what does the work."""
    return {
        "processor": platform.processor() or platform.machine(),
        "system": platform.system(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
    }


def write_report(report: object, out: Path | None = None) -> None:
    """Prints figures as JSON, and writes them to a file where one is given."""
    text = json.dumps(report, indent=2, ensure_ascii=False) + "\n"
    sys.stdout.write(text)
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_text(text, encoding="utf-8")
