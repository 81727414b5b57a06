"""The command ``datagen verify``."""

import shlex

from rich.console import Console

from datagen.datagen_config import VerifyConfig
from datagen.jobs.shard_upgrade import upgrade_folder
from pix2face.command_line import EXIT_ERROR, counted, printable, progress_bar, say
from pix2face.shards.sample_truth import WHAT_TO_DO
from pix2face.shards.shard_checks import verify_folder
from pix2face.shards.shard_reader import shard_paths

console = Console(stderr=True)


def verify(config: VerifyConfig) -> int:
    """Runs ``datagen verify``."""
    shards = config.shards
    n_shards = len(shard_paths(shards))
    if config.upgrade:
        with progress_bar(console, "converting", n_shards) as advance:
            n_upgraded = upgrade_folder(shards, advance)
        say(console, f"{counted(n_upgraded, 'shard')} of an earlier schema converted")
    with progress_bar(console, "verifying", n_shards) as advance:
        report = verify_folder(shards, advance)
    for problem in (*report.problems, *report.doubtful):
        print(printable(problem))
    if report.n_old:
        say(
            console,
            f"{counted(report.n_old, 'shard')} of an earlier schema, which all commands read; `datagen verify "
            "--upgrade` converts them",
        )
    if not report.problems and not report.doubtful:
        print(f"{counted(n_shards, 'shard')}, {counted(report.n_samples, 'sample')}: no problem found")
        return 0
    if report.doubtful:
        print(f"{counted(len(report.doubtful), 'doubt')} about ground truth; {WHAT_TO_DO}")
    if not report.problems:
        return EXIT_ERROR
    delete = "delete the damaged shards and " if report.damaged else ""
    print(
        f"{counted(len(report.problems), 'problem')}; {delete}run the same `datagen render` again: "
        "it writes what is missing"
    )
    if report.damaged:
        print(printable(f"  rm {' '.join(shlex.quote(str(path)) for path in report.damaged)}"))
    return EXIT_ERROR
