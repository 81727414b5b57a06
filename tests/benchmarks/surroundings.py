"""What a figure was measured on: the part that every benchmark's JSON shares."""

import os
import platform
from importlib.metadata import version

PACKAGES = ("numpy", "scipy", "h5py", "torch")


def surroundings() -> dict[str, object]:
    """Processor, cores, and versions of what does the work."""
    return {
        "processor": platform.processor() or platform.machine(),
        "system": platform.system(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "versions": {name: version(name) for name in PACKAGES},
    }
