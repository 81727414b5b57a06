"""The detector as a task of the trainer: scenes in, a network that finds faces out."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict
from mmap import mmap
from pathlib import Path
from typing import final

import torch
from torch import nn

from pix2face.inference.centre_files import DetectorHeader
from training.data.loader import DrawLoader
from training.data.shard_index import ShardIndex
from training.detection.backgrounds import Backgrounds
from training.detection.centre_loss import CentreLosses, SceneBatch, batch_bytes, empty_batch, fill_row
from training.detection.centre_network import CentreNetwork
from training.detection.decoys import Things
from training.detection.detector_files import load_centre_network, save_detector
from training.detection.people import People
from training.detection.scenes import SceneMaker
from training.loop.learner import Learner
from training.loop.tasks import Surroundings, draw_loader, learner_on
from training.recipe.detector_recipe import DetectorRecipe
from training.recipe.recipe import StepRecipe


@final
class SceneDraws:
    """Numbered scenes, a batch at a time; each process opens its files when it makes its first scene."""

    def __init__(self, shards: ShardIndex, backgrounds: Path, things: Sequence[Path], size_px: int, seed: int) -> None:
        self._parts = shards, backgrounds, things, size_px, seed
        self._maker: SceneMaker | None = None

    def batch(self, draws: Sequence[int]) -> SceneBatch:
        """Some scenes, by their numbers from 0 without end."""
        batch = self.empty_batch(len(draws))
        self.fill(batch, draws)
        return batch

    def batch_bytes(self, n_samples: int) -> int:
        """The memory that a batch takes."""
        return batch_bytes(n_samples, self._parts[3])

    def empty_batch(self, n_samples: int, memory: mmap | None = None) -> SceneBatch:
        """A batch for ``fill``."""
        return empty_batch(n_samples, self._parts[3], memory)

    def fill(self, batch: SceneBatch, draws: Sequence[int]) -> None:
        """Fills a batch."""
        if self._maker is None:
            shards, backgrounds, things, size_px, seed = self._parts
            self._maker = SceneMaker(People(shards), Backgrounds(backgrounds), Things(things), size_px, seed)
        for place, draw in enumerate(draws):
            fill_row(batch, place, self._maker.make(draw))


@final
class DetectorTask:
    """The training of a detector.

    Args:
        shards: People, with the layers of ``training.detection.people.PEOPLE_LAYERS``.
        backgrounds: Folder of pictures that show nobody.
        things: Folders of drawn things.
        recipe: What to do.
        initial: A detector whose weights are started from.

    Raises:
        UsageError: A number makes no sense, or the folder holds no picture.
    """

    def __init__(
        self,
        shards: ShardIndex,
        backgrounds: Path,
        things: Sequence[Path],
        recipe: DetectorRecipe,
        initial: Path | None,
    ) -> None:
        recipe.check()
        self.recipe: StepRecipe = recipe
        self._own_recipe = recipe
        self.initial: nn.Module | None = load_centre_network(initial) if initial else None
        self._shards, self._backgrounds, self._things = shards, backgrounds, things
        start = {"initial_sha256": hashlib.sha256(initial.read_bytes()).hexdigest()} if initial else {}
        data = {
            "samples": len(shards),
            "samples_sha256": shards.samples_sha256,
            "model_sha256": shards.model_sha256,
            "where": shards.where,
            "backgrounds_sha256": Backgrounds(backgrounds).sha256(),
            "things_sha256": hashlib.sha256(b"".join(Things(things).contents())).hexdigest(),
        }
        self.configuration = json.dumps(asdict(recipe) | data | start, sort_keys=True)

    def new_learner(self, surroundings: Surroundings) -> Learner:
        """The network before its first step."""
        recipe = self._own_recipe
        losses = CentreLosses(recipe.box_weight)
        return learner_on(surroundings, recipe, _new_network, losses)

    def new_loader(self, surroundings: Surroundings) -> DrawLoader[SceneBatch]:
        """What composes the scenes."""
        draws = SceneDraws(self._shards, self._backgrounds, self._things, self._own_recipe.size_px, self.recipe.seed)
        return draw_loader(draws, self.recipe.batch_size, surroundings)

    def save(self, path: Path, network: nn.Module, epochs: int, samples: int) -> None:
        """Writes the detector."""
        del epochs
        assert isinstance(network, CentreNetwork)
        header = DetectorHeader(licence=self._shards.licence, configuration=self.configuration, samples=samples)
        save_detector(path, header, network, torch.float16)


def _new_network() -> nn.Module:
    """A network with random weights, in the memory layout in which convolutions are fastest."""
    return CentreNetwork().to(memory_format=torch.channels_last)  # type: ignore[call-overload]
