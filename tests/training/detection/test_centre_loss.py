"""The truth of a cell, the loss, and the way back from answers to boxes."""

import numpy as np
import torch

from pix2face.detectors.centre_decoding import decode
from pix2face.networks.dimensions import CENTRE_STRIDE
from training.data.batches import tensors_in
from training.detection.centre_loss import (
    CentreLosses,
    SceneBatch,
    cell_targets,
    fill_row,
    scene_layout,
    scenes_of,
)
from training.detection.scenes import Scene

BOXES = [np.array([10.0, 20, 42, 60]), np.array([70.5, 71, 83, 84]), np.array([-20.0, 80, 30, 140])]


LOSSES = CentreLosses(2.0)


def scene() -> Scene:
    return Scene(np.full((128, 128, 3), 7, dtype=np.uint8), list(BOXES), [True, True, True])


def empty_batch(n_scenes: int, size_px: int) -> SceneBatch:
    return scenes_of(tensors_in(scene_layout(n_scenes, size_px)))


def perfect_planes(own: Scene) -> torch.Tensor:
    """What a network that knows the truth would answer."""
    heat, boxes, _ = cell_targets(own)
    logits = np.where(heat == 1, 12.0, -12.0)
    return torch.from_numpy(np.concatenate([logits[None], boxes])).float()[None]


def test_the_truth_decodes_to_the_boxes() -> None:
    planes = perfect_planes(scene())[0].permute(1, 2, 0).numpy()
    boxes, scores = decode(planes, CENTRE_STRIDE, 0.5)
    assert (scores > 0.99).all()
    order = [int(np.abs(boxes - own).sum(axis=1).argmin()) for own in BOXES]
    assert sorted(order) == [0, 1, 2]
    np.testing.assert_allclose(boxes[order], BOXES, atol=0.05)


def test_the_truth_costs_nothing_and_mistakes_do() -> None:
    own = scene()
    batch = empty_batch(1, 128)
    fill_row(batch, 0, own)
    planes = perfect_planes(own)
    losses = LOSSES.parts(planes, batch)
    assert losses["box"] == 0
    assert losses["heat"] < 1e-3
    missed = planes.clone()
    missed[:, 0] = -12
    assert LOSSES.parts(missed, batch)["heat"] > 5
    shifted = planes.clone()
    shifted[:, 1] += 1
    assert LOSSES.parts(shifted, batch)["box"] > 0.2
    assert LOSSES.total({"heat": torch.tensor(1.0), "box": torch.tensor(0.5)}) == 2


def test_faces_that_are_not_counted_cost_nothing_where_they_are() -> None:
    own = Scene(np.zeros((128, 128, 3), np.uint8), list(BOXES[:1]), [False])
    batch = empty_batch(1, 128)
    fill_row(batch, 0, own)
    assert not batch.is_looked_at[0, 3:7, 2:5].any()
    assert batch.is_looked_at[0, 10:].all()
    planes = torch.full((1, 5, 16, 16), -12.0)
    planes[0, 0, 4, 3] = 12  # there is something, so it is no mistake
    assert LOSSES.parts(planes, batch)["heat"] < 1e-3
    planes[0, 0, 12, 12] = 12
    assert LOSSES.parts(planes, batch)["heat"] > 5


def test_a_scene_fills_its_row_alone() -> None:
    batch = empty_batch(2, 64)
    fill_row(batch, 1, Scene(np.full((64, 64, 3), 9, np.uint8)))
    assert batch.image[1].eq(9).all()
    assert batch.image[0].eq(0).all()
    assert len(batch[1:2]) == 1
    assert batch.image.is_contiguous(memory_format=torch.channels_last)
