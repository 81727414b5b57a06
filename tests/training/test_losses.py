import pytest
import torch

from training.losses import map_loss


def test_the_loss_is_the_mean_absolute_error_over_all_pixels_and_planes():
    torch.manual_seed(0)
    planes, target = torch.randn(2, 6, 8, 8), torch.randn(2, 6, 8, 8)
    loss = map_loss(planes, target)
    assert loss.total.item() == pytest.approx((planes - target).abs().mean().item(), rel=1e-6)
    assert loss.pncc.item() == pytest.approx((planes - target)[:, :3].abs().mean().item(), rel=1e-6)
    assert loss.offset.item() == pytest.approx((planes - target)[:, 3:].abs().mean().item(), rel=1e-6)


def test_the_background_counts():
    target = torch.zeros(1, 6, 8, 8)
    planes = target.clone()
    planes[0, 0, 0, 0] = 1.0
    assert map_loss(planes, target).total.item() == pytest.approx(1 / (6 * 64))
