"""The checkpoint that commands take where none is named: the one that comes with the package."""

from pathlib import Path

from pix2face.errors import UsageError
from pix2face.runs import RUNS, latest_checkpoint

PACKAGED = Path(__file__).parent / "assets" / "checkpoint.safetensors"


def default_checkpoint(packaged: Path = PACKAGED, runs: Path = RUNS) -> Path:
    """The packaged checkpoint; while there is none, the one that was trained last.

    Args:
        packaged: Where the package has it.
        runs: Where training leaves others.

    Raises:
        UsageError: There is neither; says how to train one.
    """
    if packaged.is_file():
        return packaged
    try:
        return latest_checkpoint(runs)
    except UsageError as error:
        raise UsageError(
            f"no checkpoint comes with this version ({packaged.name} is not in its assets); {error}"
        ) from None
