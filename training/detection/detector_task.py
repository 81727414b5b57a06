"""The detector as a task of the trainer: scenes in, a network that finds faces out."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import final

import torch
from torch import Tensor, nn

from pix2face.inference.centre_files import DetectorHeader
from training.data.batches import Draws, Layout
from training.data.shard_index import ShardIndex
from training.detection.backgrounds import Backgrounds
from training.detection.centre_loss import CentreLosses, SceneBatch, fill_row, scene_layout, scenes_of
from training.detection.centre_network import CentreNetwork
from training.detection.decoys import Things
from training.detection.detector_files import load_centre_network, save_detector
from training.detection.people import People
from training.detection.scenes import SceneMaker
from training.loop.tasks import Task
from training.recipe.detector_recipe import DetectorRecipe


@final
class SceneDraws(Draws[SceneBatch]):
    """Numbered scenes; each process opens its files when it makes its first scene."""

    def __init__(self, shards: ShardIndex, backgrounds: Path, things: Sequence[Path], size_px: int, seed: int) -> None:
        self._parts, self._size_px, self._seed = (shards, backgrounds, things), size_px, seed

    @cached_property
    def _maker(self) -> SceneMaker:
        shards, backgrounds, things = self._parts
        return SceneMaker(People(shards), Backgrounds(backgrounds), Things(things), self._size_px, self._seed)

    def layout(self, n_samples: int) -> Layout:
        """The tensors of a batch."""
        return scene_layout(n_samples, self._size_px)

    def of_tensors(self, tensors: Mapping[str, Tensor]) -> SceneBatch:
        """The batch that has these tensors."""
        return scenes_of(tensors)

    def fill_row(self, batch: SceneBatch, place: int, draw: int) -> None:
        """Writes a scene to a row of a batch."""
        fill_row(batch, place, self._maker.make(draw))


@final
class DetectorTask(Task):
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

    recipe: DetectorRecipe

    def __init__(
        self,
        shards: ShardIndex,
        backgrounds: Path,
        things: Sequence[Path],
        recipe: DetectorRecipe,
        initial: Path | None,
    ) -> None:
        recipe.check()
        self.recipe, self.initial = recipe, load_centre_network(initial) if initial else None
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

    def new_network(self) -> nn.Module:
        """A network with random weights, in the memory layout in which convolutions are fastest."""
        return CentreNetwork().to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def losses(self) -> CentreLosses:
        """The losses of centres and boxes."""
        return CentreLosses(self.recipe.box_weight)

    def draws(self, cache_bytes: int) -> SceneDraws:
        """What composes the scenes."""
        del cache_bytes  # people and pictures are kept in each process
        return SceneDraws(self._shards, self._backgrounds, self._things, self.recipe.size_px, self.recipe.seed)

    def save(self, path: Path, network: nn.Module, epochs: int, samples: int) -> None:
        """Writes the detector."""
        del epochs
        assert isinstance(network, CentreNetwork)
        header = DetectorHeader(licence=self._shards.licence, configuration=self.configuration, samples=samples)
        save_detector(path, header, network, torch.float16)
