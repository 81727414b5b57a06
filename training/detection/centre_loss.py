"""What the detector's training minimises: the heatmap of centres, and the boxes where a face has its centre.

Sources: Law and Deng 2018, CornerNet, Eq. 1 (focal loss that is reduced near a centre); Zhou et al. 2019, Objects as
Points.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, UInt8
from numpy import ndarray
from torch import Tensor
from torch.nn import functional

from pix2face.networks.centre import STRIDE
from training.detection.scenes import Scene, counted_boxes

# Standard deviation of the heat around a centre, as a share of the box; at least so many cells.
SPREAD, LEAST_SPREAD = 0.09, 0.45
BOXED_HEAT = 0.5  # cells with more heat learn the box
BOX_WEIGHT: Final = 0.5


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class SceneBatch:
    """Scenes, and what the network should answer for each of their cells."""

    image: UInt8[Tensor, "b 3 h w"]  # RGB, channels last in memory
    heat: Float32[Tensor, "b y x"]  # 1 at centres, less around them, 0 elsewhere
    boxes: Float32[Tensor, "b 4 y x"]  # as the network's last four planes, where heat is above BOXED_HEAT
    is_looked_at: Bool[Tensor, "b y x"]  # where the heat counts

    def __len__(self) -> int:
        return len(self.image)


def batch_of(scenes: Sequence[Scene]) -> SceneBatch:
    """Puts scenes of one size together."""
    targets = [cell_targets(scene) for scene in scenes]
    image = torch.from_numpy(np.stack([scene.image for scene in scenes])).permute(0, 3, 1, 2)
    heat, boxes, looked = (torch.from_numpy(np.stack(part)) for part in zip(*targets, strict=True))
    return SceneBatch(image=image, heat=heat, boxes=boxes, is_looked_at=looked)


def cell_targets(
    scene: Scene,
) -> tuple[Float32[ndarray, "y x"], Float32[ndarray, "4 y x"], Bool[ndarray, "y x"]]:
    """Heat, boxes and where the heat counts, in cells of ``STRIDE`` pixels."""
    rows, columns = (extent // STRIDE for extent in scene.image.shape[:2])
    heat = np.zeros((rows, columns), dtype=np.float32)
    boxes = np.zeros((4, rows, columns), dtype=np.float32)
    looked = np.ones((rows, columns), dtype=bool)
    counted, others = counted_boxes(scene)
    for box in others:
        left, top, right, bottom = np.rint(np.clip(box / STRIDE, 0, max(rows, columns))).astype(int)
        looked[top : max(bottom, top + 1), left : max(right, left + 1)] = False
    y, x = np.mgrid[:rows, :columns].astype(np.float32) + 0.5
    for box in counted / STRIDE:
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


def centre_losses(planes: Float[Tensor, "b 5 y x"], batch: SceneBatch) -> dict[str, Float[Tensor, ""]]:
    """The parts of the loss by name, unweighted: each a sum over cells, divided by the number of faces."""
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
