"""The command ``train detector``: people and pictures without people in, a detector of faces out."""

from training.data.shard_folders import parse_shard_folders
from training.data.shard_index import index_shards
from training.detection.detector_task import DetectorTask
from training.detection.people import PEOPLE_LAYERS
from training.task_run import run_task
from training.train_config import DetectorConfig


def detector(config: DetectorConfig) -> int:
    """Runs ``train detector``."""
    shards = index_shards(parse_shard_folders(config.shards), layers=PEOPLE_LAYERS)
    task = DetectorTask(shards, config.backgrounds, config.things, config.numbers, config.init)
    return run_task(task, "scene", f"people: {shards.description}", config)
