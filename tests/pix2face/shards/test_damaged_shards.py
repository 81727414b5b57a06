"""Random damage to shards and tables, a little of it; tests.fuzz_shards does as much of it as one likes."""

import subprocess
import sys
from pathlib import Path

FORMATS = ("shard", "shard-plain", "shard-2-zstd", "table")


def test_random_damage_is_read_or_refused() -> None:
    """In a process of its own, with a limit on its memory: a crash would end it."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz_shards", "--cases", "40", "--seed", "11", "--formats", *FORMATS],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[3],
    )
    assert done.returncode == 0, done.stdout
    assert done.stdout.count(" 0 failed") == len(FORMATS)
