from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from pix2face.networks.dimensions import residual_widths
from pix2face.networks.residual import ResidualUNet
from tests.synthetic_models import small_head_model
from training.data.batches import Batch, target_planes
from training.data.shard_index import index_shards
from training.loop.observers import TensorboardLog, prediction_pictures
from training.loop.run_configuration import checkpoint_header
from training.loop.validation import Scores, ValidationSet, Validator, validator_of
from training.recipe.presets import PRESETS

RECIPE = replace(PRESETS["cpu"], size_px=64, filters=2, planes=7)


@pytest.fixture(scope="module")
def shards(shards_dir):
    return index_shards([shards_dir])


class Oracle(nn.Module):
    """Answers with the truth, changed."""

    def __init__(self, batches: list[Batch], header, change=lambda planes: planes) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(1))
        logits = [20 * (batch.mask[:, None].float() - 0.5) for batch in batches]
        truth = [target_planes(batch, header.pncc_scale_mm, header.offset_scale_mm) for batch in batches]
        self.answers = [torch.cat(pair, dim=1) for pair in zip(truth, logits, strict=True)]
        self.change, self.calls = change, 0

    def forward(self, image: Tensor) -> Tensor:
        self.calls += 1
        return self.change(self.answers[self.calls - 1].clone())


def measured(shards, change) -> Scores:
    held_out = ValidationSet(shards, RECIPE)
    header = checkpoint_header(shards, RECIPE, "", 0, 0)
    validator = Validator(header, held_out, small_head_model())
    return validator.scores(Oracle(list(held_out.batches(16)), header, change))


def test_the_truth_has_no_error_and_a_mask_less_its_outermost_pixel(shards):
    scores = measured(shards, lambda planes: planes)
    assert scores.pncc_mm < 0.01
    assert scores.offset_mm < 0.01
    assert 0.85 < scores.mask_iou < 1
    assert scores.nme is not None
    assert scores.nme < 0.03
    assert scores.error == scores.nme


def test_errors_are_in_millimetres_over_the_true_mask(shards):
    scale_mm = shards.pncc_scale_mm

    def moved(planes: Tensor) -> Tensor:
        planes[:, 0] += 3 / scale_mm
        planes[:, 1] += 4 / scale_mm
        planes[:, 3:6] = 0
        return planes

    scores = measured(shards, moved)
    assert scores.pncc_mm == pytest.approx(5, abs=0.01)
    assert scores.offset_mm == pytest.approx(scores.offset_zero_mm, rel=1e-4)
    assert scores.offset_zero_mm > 1


def test_who_finds_nothing_is_off_by_the_whole_box(shards):
    def nothing(planes: Tensor) -> Tensor:
        planes[:, 6] = -1
        return planes

    scores = measured(shards, nothing)
    assert (scores.nme, scores.mask_iou) == (1.0, 0.0)


def test_without_the_morphable_model_pncc_decides(shards):
    validator = validator_of(shards, RECIPE, 3, None)
    network = ResidualUNet(residual_widths(2), 7).train()
    scores = validator.scores(network)
    assert scores.nme is None
    assert scores.error == scores.pncc_mm
    assert "nme" not in scores.as_numbers()
    assert network.training


@pytest.mark.parametrize(("every", "due"), [(None, [12]), (5, [6, 12, 15]), (3, [3, 6, 9, 12, 15])])
def test_it_is_due_at_the_end_of_an_epoch_or_after_so_many_samples(shards, every, due):
    validator = validator_of(shards, RECIPE, 1, every)
    found = [samples for samples in range(3, 18, 3) if validator.is_due(samples, 3, is_end=samples == 12)]
    assert found == due


def test_pictures_of_predictions_stand_beside_the_truth(shards):
    held_out = validator_of(shards, RECIPE, 3, None)
    pictures = prediction_pictures(ResidualUNet(residual_widths(2), 7), held_out)
    assert pictures.shape == (3, 3 * 64, 6 * 64)
    assert 0 <= pictures.min() < pictures.max() <= 1
    batch = held_out.first_batch()
    np.testing.assert_allclose(pictures[:, :64, :64], batch.image[0] / 255)
    true_pncc = pictures[:, :64, 128:192]
    assert torch.allclose(true_pncc[:, batch.mask[0] == 0], torch.tensor(0.5))


def test_tensorboard_gets_curves_and_pictures(shards, tmp_path):
    reader = pytest.importorskip(
        "tensorboard.backend.event_processing.event_accumulator", reason="pip install 'pix2face[tensorboard]'"
    )
    validator = validator_of(shards, RECIPE, 2, None)
    board = TensorboardLog(tmp_path, validator)
    network = ResidualUNet(residual_widths(2), 7)
    board.scores(48, validator.scores(network), network)
    board.close()
    events = reader.EventAccumulator(str(tmp_path))
    events.Reload()
    assert "validation/pncc_mm" in events.Tags()["scalars"]
    assert len(events.Tags()["images"]) == 1


def test_without_tensorboard_the_line_that_installs_it(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "torch.utils.tensorboard", None)
    with pytest.raises(Exception, match=r"pip install 'pix2face\[tensorboard\]'"):
        TensorboardLog(tmp_path, None)
