"""The command ``train correction``: shards and a network in, the network with a correction of its fits out."""

from rich.console import Console

from pix2face.command_line import say
from pix2face.inference import PACKAGED
from pix2face.models.morphable_model import open_model
from training.correction.correction_task import CorrectionTask
from training.data.shard_folders import parse_shard_folders
from training.data.shard_index import index_shards
from training.loop.tasks import Surroundings
from training.task_run import run_task
from training.train_config import CorrectionConfig


def correction(config: CorrectionConfig) -> int:
    """Runs ``train correction``."""
    shards = index_shards(parse_shard_folders(config.shards))
    task = CorrectionTask(shards, config.checkpoint or PACKAGED, open_model(config.model), config.numbers)
    say(Console(stderr=True), f"faces: {shards.description}")
    surroundings = Surroundings(
        device=config.device, workers=config.workers, cache_bytes=0, state_minutes=config.state_minutes
    )
    return run_task(task, "face", config.out, surroundings)
