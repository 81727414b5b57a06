"""Where training leaves its checkpoints."""

from pathlib import Path

from pix2face.errors import UsageError

CHECKPOINT_NAME = "checkpoint.safetensors"
RUNS = Path("runs")


def latest_checkpoint(runs: Path = RUNS) -> Path:
    """The checkpoint that was written last below a folder of runs (``RUN/checkpoint.safetensors``).

    Raises:
        UsageError: There is none; says how to train one.
    """
    written = [(path.stat().st_mtime_ns, path) for path in runs.glob(f"*/{CHECKPOINT_NAME}")]
    if not written:
        raise UsageError(
            f"expected a checkpoint at {runs}/*/{CHECKPOINT_NAME}, found none: pass --checkpoint (`make demo` "
            f"leaves demo/run/{CHECKPOINT_NAME}), or train one: `train --shards SHARDS --out {runs}/tiny --preset tiny`"
        )
    return max(written)[1]
