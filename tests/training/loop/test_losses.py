import math
from dataclasses import replace

import pytest
import torch
from torch.nn import functional

from tests.training.random_batches import random_batch
from training.data.batches import target_planes
from training.loop.losses import LossPlan
from training.recipe.presets import PRESETS
from training.recipe.recipe import LossWeights

EQUAL = LossWeights()
PLAN = LossPlan(pncc_scale_mm=8.0, offset_scale_mm=2.0, weights=EQUAL, over="all")
BATCH = random_batch(replace(PRESETS["tiny"], batch_size=3, size_px=8))
TARGET = target_planes(BATCH, 8.0, 2.0)


def planes_of(n: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(3, n, 8, 8, generator=torch.Generator().manual_seed(seed))


def test_with_equal_weights_it_is_the_papers_mean_absolute_error_over_all_pixels_and_planes():
    planes = planes_of(6)
    parts = PLAN.parts(planes, BATCH)
    assert list(parts) == ["pncc", "offset"]
    assert PLAN.total(parts).item() == pytest.approx((planes - TARGET).abs().mean().item(), rel=1e-6)
    assert parts["pncc"].item() == pytest.approx((planes - TARGET)[:, :3].abs().mean().item(), rel=1e-6)
    assert parts["offset"].item() == pytest.approx((planes - TARGET)[:, 3:].abs().mean().item(), rel=1e-6)


def test_each_part_has_its_weight():
    weighted = replace(PLAN, weights=LossWeights(pncc=1, offset=4, mask=0.5, seen=0))
    parts = weighted.parts(planes_of(8), BATCH)
    assert list(parts) == ["pncc", "offset", "mask", "seen"]
    expected = (parts["pncc"] + 4 * parts["offset"] + 0.5 * parts["mask"]) / 5.5
    assert weighted.total(parts).item() == pytest.approx(expected.item(), rel=1e-6)


def test_masks_are_compared_by_cross_entropy():
    planes = planes_of(8)
    parts = PLAN.parts(planes, BATCH)
    for name, place, truth in (("mask", 6, BATCH.mask), ("seen", 7, BATCH.seen)):
        probability = planes[:, place].sigmoid()
        expected = functional.binary_cross_entropy(probability, truth.float())
        assert parts[name].item() == pytest.approx(expected.item(), rel=1e-5)


def test_the_background_counts_only_where_all_pixels_do():
    background = (BATCH.mask == 0).float()[:, None]
    off = TARGET + background
    assert PLAN.parts(off, BATCH)["pncc"].item() == pytest.approx(background.mean().item(), rel=1e-5)
    assert replace(PLAN, over="mask").parts(off, BATCH)["pncc"].item() == 0


@pytest.mark.parametrize("over", ["mask", "seen"])
def test_inside_a_mask_every_picture_counts_the_same(over):
    planes = planes_of(6)
    inside = BATCH.mask if over == "mask" else BATCH.seen
    means = []
    for own, truth, mask in zip(planes, TARGET, inside.bool(), strict=True):
        means.append((own - truth)[:3, mask].abs().mean().item())
    found = replace(PLAN, over=over).parts(planes, BATCH)["pncc"].item()
    assert found == pytest.approx(sum(means) / 3, rel=1e-5)


@pytest.mark.parametrize("over", ["all", "mask"])
def test_a_batch_is_the_mean_of_its_pictures(over):
    plan, planes = replace(PLAN, over=over), planes_of(7)
    alone = [plan.parts(planes[i : i + 1], BATCH[i : i + 1]) for i in range(3)]
    for name, value in plan.parts(planes, BATCH).items():
        assert value.item() == pytest.approx(sum(own[name].item() for own in alone) / 3, rel=1e-5)


def test_a_picture_without_a_face_has_no_error_inside_its_mask():
    empty = replace(BATCH, mask=torch.zeros_like(BATCH.mask))
    assert replace(PLAN, over="mask").parts(planes_of(6), empty)["pncc"].item() == 0


def test_the_scale_learns_from_the_errors_and_the_maps_do_not_learn_from_the_scale():
    planes = planes_of(9).requires_grad_()
    PLAN.parts(planes, BATCH)["scale"].backward()
    assert planes.grad is not None
    assert planes.grad[:, :8].abs().max() == 0
    assert planes.grad[:, 8].abs().min() > 0
    best = (planes.detach()[:, :3] - TARGET[:, :3]).abs().mean(dim=1).log()
    at_best = torch.cat([planes.detach()[:, :8], best[:, None]], dim=1).requires_grad_()
    PLAN.parts(at_best, BATCH)["scale"].backward()
    assert at_best.grad is not None
    assert at_best.grad.abs().max() < 1e-8


def test_landmarks_are_likeliest_at_the_truth_with_half_their_mean_distance_as_scale():
    batch = random_batch(replace(PRESETS["tiny"], batch_size=3, size_px=8, n_landmarks=68))
    true = batch.landmarks2d / 8 - 0.5

    def loss(places: torch.Tensor, scale: float) -> float:
        numbers = torch.cat([places, torch.full((3, 68, 1), scale).log()], dim=2)
        return PLAN.parts((planes_of(8), numbers), batch)["landmarks"].item()

    off = true + torch.tensor([0.06, 0.08])  # a tenth of the side
    assert loss(true, 0.05) < loss(off, 0.05)
    assert loss(off, 0.05) < min(loss(off, 0.04), loss(off, 0.06))
    assert loss(off, 0.05) == pytest.approx(2 + 2 * math.log(0.05), rel=1e-5)


LARGE = random_batch(replace(PRESETS["tiny"], batch_size=3, size_px=64))


def linear_part(planes: torch.Tensor) -> float:
    return replace(PLAN, weights=LossWeights(linear=1)).parts(planes, LARGE)["linear"].item()


@pytest.mark.parametrize(("is_made_up_by_offsets", "share"), [(False, 1.0), (True, 0.5)])
def test_linear_errors_of_the_mean_face_and_of_this_face_are_measured_in_full(is_made_up_by_offsets, share):
    truth = target_planes(LARGE, 8.0, 2.0)
    error = 0.1 + 0.05 * truth[:, :3].roll(1, dims=1)
    seen = (error.abs() * LARGE.mask[:, None])[..., ::2, ::2].sum(dim=(2, 3))
    expected = (seen / LARGE.mask[:, None, ::2, ::2].sum(dim=(2, 3))).mean().item()
    offset_error = -4 * error if is_made_up_by_offsets else torch.zeros_like(error)  # a fourth of PNCC's scale
    off = truth + torch.cat((error, offset_error), dim=1)
    assert linear_part(truth) == pytest.approx(0, abs=1e-5)
    assert linear_part(off) == pytest.approx(share * expected, rel=0.002)


def test_noise_has_hardly_a_linear_part():
    noise = torch.randn(3, 6, 64, 64, generator=torch.Generator().manual_seed(1))
    assert linear_part(target_planes(LARGE, 8.0, 2.0) + noise) < 0.1 * noise.abs().mean().item()
