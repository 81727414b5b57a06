"""The correction of fits as a task of the trainer: fits in, a network that corrects its own fits out."""

import hashlib
import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import final

import numpy as np
from torch import nn

from pix2face.errors import UsageError
from pix2face.fitting.prepared_model import spread_vertices, vertex_basis
from pix2face.geometry.landmarks import IBUG68
from pix2face.inference.checkpoint import load_checkpoint, save_checkpoint
from pix2face.models.morphable_model import MorphableModel
from pix2face.networks.correction import FitCorrection
from pix2face.networks.residual import ResidualUNet, correction_widths
from training.correction.correction_loss import CorrectionLosses
from training.correction.fit_batch import FitBatch, FitShape
from training.correction.fitted_crops import FittedCrops
from training.data.loader import DrawLoader
from training.data.shard_index import ShardIndex
from training.loop.learner import Learner
from training.loop.tasks import Surroundings, draw_loader
from training.recipe.correction_recipe import CorrectionRecipe
from training.recipe.recipe import StepRecipe

# Points of the face that are compared, beside its landmarks.
SPREAD_POINTS = 128


@final
class CorrectionTask:
    """The training of what corrects the fits of a network. The network itself does not change.

    Args:
        shards: Rendered faces.
        checkpoint: The network. If it has a correction, that is replaced.
        model: The morphable model of both.
        recipe: What to do.

    Raises:
        UsageError: A number makes no sense, or the network is of another architecture than ``residual``.
        ModelMismatchError: The network was trained for another model than this one, or than that of the shards.
    """

    def __init__(self, shards: ShardIndex, checkpoint: Path, model: MorphableModel, recipe: CorrectionRecipe) -> None:
        recipe.check()
        self.header, network = load_checkpoint(checkpoint)
        for name, sha256 in ((model.name, model.sha256), (shards.model_name, shards.model_sha256)):
            self.header.check_model(name, sha256)
        if not isinstance(network, ResidualUNet):
            raise UsageError(
                f"{checkpoint}: expected a network of the architecture residual, found {self.header.architecture}"
            )
        coefficients = model.n_identity + model.n_expression
        own = replace(recipe, level_widths=correction_widths(self.header.widths), coefficients=coefficients)
        self.recipe: StepRecipe = own
        self.initial: nn.Module | None = None
        self._network, self._shards, self._checkpoint, self._model = network, shards, checkpoint, model
        vertices = np.concatenate([spread_vertices(model, SPREAD_POINTS), model.landmarks.get(IBUG68, [])]).astype(int)
        self._face = model.mean[vertices], vertex_basis(model, vertices)
        self._shape = FitShape(
            size_px=self.header.size_px,
            level_widths=own.level_widths,
            coefficients=coefficients,
            points=len(vertices),
        )
        data = {
            "checkpoint_sha256": hashlib.sha256(checkpoint.read_bytes()).hexdigest(),
            "samples": len(shards),
            "samples_sha256": shards.samples_sha256,
            "where": shards.where,
        }
        self.configuration = json.dumps(asdict(own) | data, sort_keys=True)

    def new_learner(self, surroundings: Surroundings) -> Learner:
        """The correction before its first step."""
        losses = CorrectionLosses(*self._face)
        return Learner(self.recipe, losses, surroundings.device, surroundings.processes, surroundings.is_compiled)

    def new_loader(self, surroundings: Surroundings) -> DrawLoader[FitBatch]:
        """What makes the fits."""
        draws = FittedCrops(self._shards, self._checkpoint, self._model, self._face, self._shape, self.recipe.seed)
        return draw_loader(draws, self.recipe.batch_size, surroundings)

    def save(self, path: Path, network: nn.Module, epochs: int, samples: int) -> None:
        """Writes the network with its correction. Epochs and samples of its header are those of the network."""
        del epochs
        assert isinstance(network, FitCorrection)
        told = json.loads(self.header.configuration)
        told["correction"] = json.loads(self.configuration) | {"fits": samples}
        licences = sorted({*self.header.licence.split("; "), *self._shards.licence.split("; ")})
        header = replace(
            self.header,
            configuration=json.dumps(told, sort_keys=True),
            licence="; ".join(licences),
            n_corrected=self._shape.coefficients,
        )
        self._network.correction = network
        save_checkpoint(path, header, self._network)
