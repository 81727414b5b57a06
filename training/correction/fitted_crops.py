"""Crops of rendered faces, what a network sees in them, and the fits to its maps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from mmap import mmap
from pathlib import Path
from typing import final

import numpy as np
import torch
from jaxtyping import Bool, Float32, Float64
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError
from pix2face.fitting.fit_options import FitOptions
from pix2face.fitting.picture_measurement import measure_picture
from pix2face.geometry.camera import Camera, linearised
from pix2face.geometry.crops import FaceBox, pixels_in_image
from pix2face.geometry.jitter import JitterRange, draw_jitter, jitter_crop, jitter_image
from pix2face.inference.checkpoint import CheckpointHeader, load_checkpoint
from pix2face.inference.predictor import centred_rows, keep_networks_in_one_thread, read_planes
from pix2face.models.mirroring import mirrored_coefficients
from pix2face.models.morphable_model import MorphableModel
from pix2face.networks.residual import ResidualUNet, folded
from pix2face.shards.layers import IMAGE
from training.correction.fit_batch import FitBatch, FitShape, batch_bytes, empty_batch
from training.data.draw_order import JITTER_STREAM, DrawOrder
from training.data.shard_index import ShardIndex

# Crops are those of boxes that are a few per cent off, in the colours of all kinds of photographs.
SCALE_SPREAD = 0.08
JITTER = JitterRange(shift=0.04, rotation_deg=6.0, gamma=(0.65, 1.5), gain=0.75, contrast=(0.75, 1.8))
# What is corrected are the default fits.
FIT = FitOptions(correction=False)
CROPS_AT_A_TIME = 16


@final
@dataclass(frozen=True, eq=False)
class KnownCrop:
    """A crop of a face that is known."""

    picture: Float32[ndarray, "s s 3"]  # RGB in [-0.5, 0.5]
    in_photograph: Bool[ndarray, "s s"] | None  # which pixels show the photograph; None if all do
    camera: Camera  # from the model frame to the pixels of the crop
    coefficients: Float64[ndarray, " c"]  # standard deviations, identity before expression


@final
class FittedCrops:
    """Numbered fits, a batch at a time. Each process opens the network when it makes its first batch.

    Args:
        shards: Rendered faces.
        checkpoint: The network whose fits are corrected.
        model: Its morphable model.
        face: Points of the mean face whose places are compared (mm), and how coefficients move them.
        shape: Of the batches.
        seed: Of the order of samples and of their crops.
    """

    def __init__(
        self,
        shards: ShardIndex,
        checkpoint: Path,
        model: MorphableModel,
        face: tuple[Float32[ndarray, "p 3"], Float32[ndarray, "p 3 c"]],
        shape: FitShape,
        seed: int,
    ) -> None:
        self._shards, self._checkpoint, self._model = shards, checkpoint, model
        self._mean, self._basis = face
        self._shape, self._seed = shape, seed
        self._order = DrawOrder(shards.sets, seed)
        self._mirrors = None if shards.mirror_obstacle else mirrored_coefficients(model)
        self._network: tuple[CheckpointHeader, ResidualUNet] | None = None

    def batch(self, draws: Sequence[int]) -> FitBatch:
        """Some fits, by their numbers from 0 without end."""
        batch = self.empty_batch(len(draws))
        self.fill(batch, draws)
        return batch

    def batch_bytes(self, n_samples: int) -> int:
        """The memory that a batch takes."""
        return batch_bytes(n_samples, self._shape)

    def empty_batch(self, n_samples: int, memory: mmap | None = None) -> FitBatch:
        """A batch for ``fill``."""
        return empty_batch(n_samples, self._shape, memory)

    def fill(self, batch: FitBatch, draws: Sequence[int]) -> None:
        """Fills a batch.

        Raises:
            InputFileError: A sample is damaged.
        """
        if self._network is None:
            keep_networks_in_one_thread()
            header, network = load_checkpoint(self._checkpoint)
            assert isinstance(network, ResidualUNet)
            self._network = header, folded(network)
        for first in range(0, len(draws), CROPS_AT_A_TIME):
            crops = [self._crop(draw, self._network[0].crop_scale) for draw in draws[first : first + CROPS_AT_A_TIME]]
            self._fill(batch.rows(first, first + len(crops)), crops, *self._network)

    def _crop(self, draw: int, scale: float) -> KnownCrop:
        """The crop of a draw. It depends only on the seed and on the number of the draw."""
        number = self._order.sample_of(draw)
        sample = self._shards.readers[self._shards.shard[number]].read(int(self._shards.position[number]), [IMAGE])
        limits = replace(
            JITTER, scale=(scale * (1 - SCALE_SPREAD), scale * (1 + SCALE_SPREAD)), mirror=self._mirrors is not None
        )
        jitter = draw_jitter(np.random.default_rng([JITTER_STREAM, self._seed, draw]), limits)
        image = sample.image
        crop = jitter_crop(FaceBox.around(sample.landmarks2d), jitter, self._shape.size_px)
        identity, expression = sample.identity, sample.expression
        camera = sample.camera.transformed(crop.crop_from_image)
        if jitter.mirror and self._mirrors is not None:
            identity, expression = identity @ self._mirrors.identity, expression @ self._mirrors.expression
            camera = Camera(camera.matrix * [-1, 1, 1, 1])
        return KnownCrop(
            jitter_image(image, crop, jitter) - np.float32(0.5),
            pixels_in_image(crop, image.shape[:2]),
            camera,
            np.concatenate([identity, expression]).astype(np.float64),
        )

    def _fill(
        self, rows: FitBatch, crops: Sequence[KnownCrop], header: CheckpointHeader, network: ResidualUNet
    ) -> None:
        with torch.inference_mode():
            pictures = torch.from_numpy(np.stack([crop.picture for crop in crops])).permute(0, 3, 1, 2)
            planes, _, levels = network.read(pictures)
            for stored, level in zip(rows.levels, levels, strict=True):
                stored.copy_(level.permute(0, 2, 3, 1))
            answers = np.ascontiguousarray(planes.permute(0, 2, 3, 1).numpy())
        for place, (crop, answer) in enumerate(zip(crops, answers, strict=True)):
            self._fill_row(rows.rows(place, place + 1), crop, answer, header)

    def _fill_row(
        self, row: FitBatch, crop: KnownCrop, answer: Float32[ndarray, "s s planes"], header: CheckpointHeader
    ) -> None:
        size_px, true_camera = self._shape.size_px, linearised(crop.camera)
        maps, _ = read_planes(answer, header)
        try:
            fit = measure_picture(replace(maps, in_photograph=crop.in_photograph), self._model, FIT)
            camera, coefficients, is_fitted = fit.camera, fit.coefficients, True
        except DegenerateGeometryError:
            camera, coefficients, is_fitted = true_camera, crop.coefficients, False
        row.is_fitted[0] = is_fitted
        points = self._mean + self._basis @ crop.coefficients
        values = (
            (row.cameras, centred_rows(camera, size_px)),
            (row.coefficients, coefficients),
            (row.true_cameras, centred_rows(true_camera, size_px)),
            (row.true_coefficients, crop.coefficients),
            (row.points2d, crop.camera.project(points) / size_px - 0.5),
        )
        for stored, value in values:
            stored[0] = torch.from_numpy(np.asarray(value))
