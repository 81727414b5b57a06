"""The commands ``train detector`` and ``train correction``."""

from pix2face.inference import PACKAGED
from pix2face.models.morphable_model import open_model
from training.correction.correction_task import CorrectionTask
from training.data.shard_folders import parse_shard_folders
from training.data.shard_index import index_shards
from training.detection.detector_task import DetectorTask
from training.detection.people import PEOPLE_LAYERS
from training.task_run import run_task
from training.train_config import CorrectionConfig, DetectorConfig


def detector(config: DetectorConfig) -> int:
    """Runs ``train detector``: people and pictures without people in, a detector of faces out."""
    shards = index_shards(parse_shard_folders(config.shards), layers=PEOPLE_LAYERS)
    task = DetectorTask(shards, config.backgrounds, config.things, config.numbers, config.init)
    return run_task(task, "scene", f"people: {shards.description}", config)


def correction(config: CorrectionConfig) -> int:
    """Runs ``train correction``: shards and a network in, the network with a correction of its fits out."""
    shards = index_shards(parse_shard_folders(config.shards))
    task = CorrectionTask(shards, config.checkpoint or PACKAGED, open_model(config.model), config.numbers)
    return run_task(task, "face", f"faces: {shards.description}", config)
