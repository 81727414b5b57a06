"""The correction of fits as a task of the trainer: rendered faces in, a network that corrects its own fits out."""

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
from pix2face.inference.torch_networks import load_checkpoint, save_checkpoint
from pix2face.models.morphable_model import MorphableModel
from pix2face.networks import SEEN_PLANE
from pix2face.networks.correction import FitCorrection
from pix2face.networks.dimensions import correction_widths
from pix2face.networks.residual import ResidualUNet
from training.correction.correction_loss import CorrectionLosses
from training.correction.fitting_network import FittingNetwork, fit_of
from training.correction.known_faces import KnownCrops
from training.data.shard_index import ShardIndex
from training.loop.losses import LossPlan
from training.loop.tasks import Task, check_landmarks
from training.recipe.correction_recipe import CorrectionRecipe
from training.recipe.recipe import LossWeights

# Points of the face that are compared, beside its landmarks.
SPREAD_POINTS = 128
# Of the loss of the maps, where the network learns as well.
MAP_WEIGHTS = LossWeights(offset=0.5, linear=2.0, mask=0.2, seen=0.2)


@final
class CorrectionTask(Task):
    """The training of what corrects the fits of a network, alone or together with the network.

    Args:
        shards: Rendered faces.
        checkpoint: The network. If it has a correction, the training starts from that.
        model: The morphable model of both.
        recipe: What to do.

    Raises:
        UsageError: A number makes no sense, the network is of another architecture than ``residual``, or it predicts
            what the shards do not have.
        ModelMismatchError: The network was trained for another model than this one, or than that of the shards.
    """

    recipe: CorrectionRecipe

    def __init__(self, shards: ShardIndex, checkpoint: Path, model: MorphableModel, recipe: CorrectionRecipe) -> None:
        recipe.check()
        header, network = load_checkpoint(checkpoint)
        for name, sha256 in ((model.name, model.sha256), (shards.model_name, shards.model_sha256)):
            header.check_model(name, sha256)
        if not isinstance(network, ResidualUNet):
            raise UsageError(
                f"{checkpoint}: expected a network of the architecture residual, found {header.architecture}"
            )
        if not recipe.frozen and header.planes > SEEN_PLANE and not shards.knows_seen:
            raise UsageError(
                "--shards: expected the layer seen, which the network predicts, found shards without it; render "
                "synthetic photographs, or give --frozen, which trains the correction alone"
            )
        check_landmarks(shards, header.n_landmarks, "--shards", "render faces of the model of the network")
        self.header = replace(header, n_corrected=model.n_identity + model.n_expression)
        self.recipe, self.initial = recipe, None
        self._network, self._shards, self._model = network, shards, model
        vertices = np.concatenate([spread_vertices(model, SPREAD_POINTS), model.landmarks.get(IBUG68, [])]).astype(int)
        self._face = model.mean[vertices], vertex_basis(model, vertices)
        data = {
            "checkpoint_sha256": hashlib.sha256(checkpoint.read_bytes()).hexdigest(),
            "samples": len(shards),
            "samples_sha256": shards.samples_sha256,
            "where": shards.where,
        }
        self.configuration = json.dumps(asdict(recipe) | data, sort_keys=True)

    def new_network(self) -> FittingNetwork:
        """The network, with a new correction unless it has one."""
        if self._network.correction is None:
            self._network.correction = FitCorrection(correction_widths(self.header.widths), self.header.n_corrected)
        return FittingNetwork(self._network, self.header, fit_of(self._model), is_frozen=self.recipe.frozen)

    def losses(self) -> CorrectionLosses:
        """The losses of the corrected fits, and of the maps if the network learns."""
        header = self.header
        maps = LossPlan(
            pncc_scale_mm=header.pncc_scale_mm, offset_scale_mm=header.offset_scale_mm, weights=MAP_WEIGHTS, over="mask"
        )
        return CorrectionLosses(*self._face, None if self.recipe.frozen else maps)

    def draws(self, cache_bytes: int) -> KnownCrops:
        """Crops of faces."""
        del cache_bytes  # samples are not kept
        return KnownCrops(self._shards, self._model, self._face, self.header, self.recipe.seed)

    def save(self, path: Path, network: nn.Module, epochs: int, samples: int) -> None:
        """Writes the network with its correction. Epochs and samples of its header are those of the training before."""
        del epochs
        assert isinstance(network, FittingNetwork)
        told = json.loads(self.header.configuration)
        told["correction"] = json.loads(self.configuration) | {"fits": samples}
        licences = sorted({*self.header.licence.split("; "), *self._shards.licence.split("; ")})
        header = replace(self.header, configuration=json.dumps(told, sort_keys=True), licence="; ".join(licences))
        save_checkpoint(path, header, network.network)
