"""Crops of rendered faces whose maps, camera and coefficients are known."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
import torch
from jaxtyping import Float32, UInt8
from numpy import ndarray
from torch import Tensor

from pix2face.geometry.camera import Camera, linearised
from pix2face.geometry.crops import FaceBox, pixels_in_image
from pix2face.geometry.jitter import JitterRange, draw_jitter, jitter_crop
from pix2face.inference.checkpoint import CheckpointHeader
from pix2face.inference.fit_correction import centred_rows
from pix2face.models.mirroring import mirrored_coefficients
from pix2face.models.morphable_model import MorphableModel
from training.data.batches import Batch, Draws, Layout, TrainingBatch, batch_layout, batch_of, batch_row
from training.data.cropping import resample, vary_colours
from training.data.decoded_sample import decode_sample
from training.data.draw_order import JITTER_STREAM, DrawOrder
from training.data.shard_index import ShardIndex

# Crops are those of boxes that are a few per cent off, in the colours of all kinds of photographs.
SCALE_SPREAD = 0.1
SHIFT, ROTATION_DEG = 0.06, 8.0
GAMMA, GAIN, CONTRAST = (0.65, 1.5), 0.75, (0.75, 1.8)
# Of so many crops, the picture is made worse in one way: blurred, small, compressed, grey or noisy.
WORSE_SHARE, NOISY_SHARE = 0.35, 0.3


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class KnownFaces(TrainingBatch):
    """Some crops. Places are in units of the crop's side, from its middle."""

    maps: Batch
    in_photograph: UInt8[Tensor, "b s s"]  # 1 where the crop shows the photograph, 0 beyond its border
    cameras: Float32[Tensor, "b 2 4"]  # rows of the cameras, from mm; affine, also where the face is in perspective
    coefficients: Float32[Tensor, "b c"]  # standard deviations, identity before expression
    points2d: Float32[Tensor, "b p 2"]  # places of some points of the face

    def network_input(self) -> tuple[Tensor, Tensor]:
        """What ``FittingNetwork`` takes."""
        return *self.maps.network_input(), self.in_photograph


@final
class KnownCrops(Draws[KnownFaces]):
    """Numbered crops of rendered faces.

    Args:
        shards: Rendered faces.
        model: Their morphable model.
        face: Points of the mean face whose places are compared (mm), and how coefficients move them.
        header: Of the network's checkpoint, which says how large crops are and how many landmarks it predicts.
        seed: Of the order of samples and of their crops.
    """

    def __init__(
        self,
        shards: ShardIndex,
        model: MorphableModel,
        face: tuple[Float32[ndarray, "p 3"], Float32[ndarray, "p 3 c"]],
        header: CheckpointHeader,
        seed: int,
    ) -> None:
        self._shards, self._header, self._seed = shards, header, seed
        self._mean, self._basis = face
        self._checked: set[int] = set()
        self._order = DrawOrder(shards.sets, seed)
        self._mirrors = None if shards.mirror_obstacle else mirrored_coefficients(model)
        self._limits = JitterRange(
            scale=(header.crop_scale * (1 - SCALE_SPREAD), header.crop_scale * (1 + SCALE_SPREAD)),
            shift=SHIFT,
            rotation_deg=ROTATION_DEG,
            gamma=GAMMA,
            gain=GAIN,
            contrast=CONTRAST,
            mirror=self._mirrors is not None,
        )

    def layout(self, n_samples: int) -> Layout:
        """The tensors of a batch."""
        size_px, (n_points, _, n_coefficients) = self._header.size_px, self._basis.shape
        maps = batch_layout(n_samples, size_px, has_seen=self._shards.knows_seen, n_landmarks=self._header.n_landmarks)
        return {
            "cameras": (torch.float32, (n_samples, 2, 4)),
            "coefficients": (torch.float32, (n_samples, n_coefficients)),
            "points2d": (torch.float32, (n_samples, n_points, 2)),
            **maps,
            "in_photograph": (torch.uint8, (n_samples, size_px, size_px)),
        }

    def of_tensors(self, tensors: Mapping[str, Tensor]) -> KnownFaces:
        """The batch that has these tensors."""
        own = {name: tensors[name] for name in ("cameras", "coefficients", "points2d", "in_photograph")}
        return KnownFaces(maps=batch_of({name: tensors[name] for name in tensors.keys() - own.keys()}), **own)

    def fill_row(self, batch: KnownFaces, place: int, draw: int) -> None:
        """Fills a row with the crop of a draw. It depends only on the seed and on the number of the draw."""
        number, size_px = self._order.sample_of(draw), self._header.size_px
        reader, position = self._shards.readers[self._shards.shard[number]], int(self._shards.position[number])
        # The checksum is compared when a sample is read for the first time.
        sample = decode_sample(reader, position, is_checked=number not in self._checked)
        self._checked.add(number)
        known = reader.read(position, [])
        rng = np.random.default_rng([JITTER_STREAM, self._seed, draw])
        jitter = draw_jitter(rng, self._limits)
        crop = jitter_crop(FaceBox.around(sample.landmarks2d), jitter, size_px)
        pixels = batch_row(batch.maps, place)
        resample(sample, crop, pixels)
        vary_colours(pixels.image, jitter)
        make_worse(pixels.image, rng)
        identity, expression = known.identity, known.expression
        camera = known.camera.transformed(crop.crop_from_image)
        if jitter.mirror and self._mirrors is not None:
            identity, expression = identity @ self._mirrors.identity, expression @ self._mirrors.expression
            camera = Camera(camera.matrix * [-1, 1, 1, 1])
        coefficients = np.concatenate([identity, expression])
        inside = pixels_in_image(crop, sample.image.shape[:2])
        values = (
            (batch.cameras, centred_rows(linearised(camera), size_px)),
            (batch.coefficients, coefficients),
            (batch.points2d, camera.project(self._mean + self._basis @ coefficients) / size_px - 0.5),
            (batch.in_photograph, np.ones((size_px, size_px), bool) if inside is None else inside),
        )
        for stored, value in values:
            stored[place] = torch.from_numpy(np.asarray(value))


def make_worse(image: UInt8[ndarray, "s s 3"], rng: np.random.Generator) -> None:
    """Blurs, shrinks, compresses or greys some pictures and adds noise to some, in place."""
    if rng.random() > WORSE_SHARE:
        return
    worse, side, kind = image, len(image), rng.integers(5)
    if kind == 0:
        worse = cv2.GaussianBlur(worse, (5, 5), rng.uniform(0.4, 1.4))
    elif kind == 1:
        smaller = round(side * rng.uniform(0.3, 0.7))
        enlarged_by = cv2.INTER_LINEAR if rng.random() < 0.5 else cv2.INTER_CUBIC
        worse = cv2.resize(
            cv2.resize(worse, (smaller, smaller), interpolation=cv2.INTER_AREA), (side, side), interpolation=enlarged_by
        )
    elif kind == 2:
        _, content = cv2.imencode(".jpg", worse, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(8, 60))])
        worse = np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR))
    elif kind == 3:
        worse = cv2.cvtColor(cv2.cvtColor(worse, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    if kind == 4 or rng.random() < NOISY_SHARE:
        planes = 3 if rng.random() < 0.5 else 1
        worse = np.clip(worse + rng.normal(0, rng.uniform(2, 14), (side, side, planes)), 0, 255).astype(np.uint8)
    image[:] = worse
