"""What the detector's training minimises: the heatmap of centres, and the boxes where a face has its centre.

Sources: Law and Deng 2018, CornerNet, Eq. 1 (focal loss that is reduced near a centre); Zhou et al. 2019, Objects as
Points.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, UInt8
from numpy import ndarray
from torch import Tensor
from torch.nn import functional

from pix2face.networks.dimensions import CENTRE_STRIDE
from training.data.batches import Layout, TrainingBatch, as_input
from training.detection.scenes import Scene, counted_boxes

# Standard deviation of the heat around a centre, as a share of the box; at least so many cells.
SPREAD, LEAST_SPREAD = 0.09, 0.45
BOXED_HEAT = 0.5  # cells with more heat learn the box


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class SceneBatch(TrainingBatch):
    """Scenes, and what the network should answer for each of their cells."""

    image: UInt8[Tensor, "b 3 h w"]  # RGB, channels last in memory
    heat: Float32[Tensor, "b y x"]  # 1 at centres, less around them, 0 elsewhere
    boxes: Float32[Tensor, "b 4 y x"]  # as the network's last four planes, where heat is above BOXED_HEAT
    is_looked_at: Bool[Tensor, "b y x"]  # where the heat counts

    def network_input(self) -> tuple[Float32[Tensor, "b 3 h w"]]:
        """The pictures, as the network takes them."""
        return (as_input(self.image),)


def scene_layout(n_scenes: int, size_px: int) -> Layout:
    """The tensors of a batch."""
    side = size_px // CENTRE_STRIDE
    return {
        "heat": (torch.float32, (n_scenes, side, side)),
        "boxes": (torch.float32, (n_scenes, 4, side, side)),
        "image": (torch.uint8, (n_scenes, size_px, size_px, 3)),
        "is_looked_at": (torch.bool, (n_scenes, side, side)),
    }


def scenes_of(tensors: Mapping[str, Tensor]) -> SceneBatch:
    """The batch that has the tensors of ``scene_layout``."""
    return SceneBatch(**{**tensors, "image": tensors["image"].permute(0, 3, 1, 2)})


def fill_row(batch: SceneBatch, place: int, scene: Scene) -> None:
    """Writes a scene and its targets to one row of a batch."""
    heat, boxes, looked = cell_targets(scene)
    batch.image[place] = torch.from_numpy(scene.image).permute(2, 0, 1)
    batch.heat[place], batch.boxes[place] = torch.from_numpy(heat), torch.from_numpy(boxes)
    batch.is_looked_at[place] = torch.from_numpy(looked)


def cell_targets(
    scene: Scene,
) -> tuple[Float32[ndarray, "y x"], Float32[ndarray, "4 y x"], Bool[ndarray, "y x"]]:
    """Heat, boxes and where the heat counts, in cells of ``CENTRE_STRIDE`` pixels."""
    rows, columns = (extent // CENTRE_STRIDE for extent in scene.image.shape[:2])
    heat = np.zeros((rows, columns), dtype=np.float32)
    boxes = np.zeros((4, rows, columns), dtype=np.float32)
    looked = np.ones((rows, columns), dtype=bool)
    counted, others = counted_boxes(scene)
    for box in others:
        left, top, right, bottom = np.rint(np.clip(box / CENTRE_STRIDE, 0, max(rows, columns))).astype(int)
        looked[top : max(bottom, top + 1), left : max(right, left + 1)] = False
    y, x = np.mgrid[:rows, :columns].astype(np.float32) + 0.5
    for box in counted / CENTRE_STRIDE:
        (cx, cy), (width, height) = (box[:2] + box[2:]) / 2, box[2:] - box[:2]
        spread_x, spread_y = max(SPREAD * width, LEAST_SPREAD), max(SPREAD * height, LEAST_SPREAD)
        own = np.exp(-(((x - cx) / spread_x) ** 2 + ((y - cy) / spread_y) ** 2) / 2)
        row, column = min(max(int(cy), 0), rows - 1), min(max(int(cx), 0), columns - 1)
        own[row, column] = 1
        nearer = (own > heat) & (own > BOXED_HEAT)
        numbers = np.stack([cx - x, cy - y, np.full_like(x, np.log(width)), np.full_like(x, np.log(height))])
        boxes[:, nearer] = numbers[:, nearer]
        heat = np.maximum(heat, own)
        looked[row, column] = True
    return heat, boxes, looked


@final
@dataclass(frozen=True)
class CentreLosses:
    """The loss of a step: heat, and boxes by their weight."""

    box_weight: float

    def parts(self, planes: Float[Tensor, "b 5 y x"], batch: SceneBatch) -> dict[str, Float[Tensor, ""]]:
        """Each part of the loss by its name, unweighted: a sum over cells, divided by the number of faces."""
        planes = planes.float()
        logits = planes[:, 0]
        is_centre = batch.heat == 1
        n_faces = is_centre.sum().clamp(min=1)
        probability = torch.sigmoid(logits)
        found = -functional.logsigmoid(logits) * (1 - probability) ** 2
        left = -functional.logsigmoid(-logits) * probability**2 * (1 - batch.heat) ** 4
        heat = (torch.where(is_centre, found, left) * batch.is_looked_at).sum() / n_faces
        weight = batch.heat * (batch.heat > BOXED_HEAT)
        size = batch.boxes[:, 2:].exp()
        shift = (planes[:, 1:3] - batch.boxes[:, :2]).abs() / size
        extent = (planes[:, 3:] - batch.boxes[:, 2:]).abs()
        # A small mistake costs what it takes of the overlap of the boxes, to first order; a large one not much more.
        per_cell = (2 * shift + extent).clamp(max=4).sum(dim=1)
        box = (per_cell * weight).sum() / weight.sum().clamp(min=1)
        return {"heat": heat, "box": box}

    def total(self, parts: dict[str, Float[Tensor, ""]]) -> Float[Tensor, ""]:
        """What is minimised."""
        return parts["heat"] + self.box_weight * parts["box"]
