import math

import pytest
import torch
from scipy.spatial.transform import Rotation

from pix2face.networks.correction import FitCorrection, rotation_and_scale, rotation_of
from pix2face.networks.dimensions import CAMERA_CHANGES, correction_widths, residual_widths
from pix2face.networks.residual import ResidualUNet

N_COEFFICIENTS = 7
LEVEL_WIDTHS = (16, 24, 32)


def generator(seed=0):
    return torch.Generator().manual_seed(seed)


def levels(count=3, seed=0):
    sides = (16, 8, 4)
    return [
        torch.rand(count, width, side, side, generator=generator(seed))
        for width, side in zip(LEVEL_WIDTHS, sides, strict=True)
    ]


def fits(count=3, seed=1):
    """Rows of weak-perspective cameras in units of the picture's side, and coefficients."""
    rotations = torch.tensor(Rotation.random(count, random_state=seed).as_matrix(), dtype=torch.float32)
    places = torch.rand(count, 2, 1, generator=generator(seed)) / 10
    cameras = torch.cat((0.005 * rotations[:, :2], places), dim=2)
    return cameras, torch.randn(count, N_COEFFICIENTS, generator=generator(seed))


def changing(seed=2):
    """A correction that changes fits."""
    torch.manual_seed(seed)
    made = FitCorrection(LEVEL_WIDTHS, N_COEFFICIENTS)
    torch.nn.init.normal_(made.second.bias)
    torch.nn.init.normal_(made.second.weight)
    return made.eval()


def test_at_the_start_nothing_changes():
    cameras, coefficients = fits()
    found, found_coefficients = FitCorrection(LEVEL_WIDTHS, N_COEFFICIENTS)(levels(), cameras, coefficients)
    torch.testing.assert_close(found, cameras, rtol=0, atol=1e-7)
    torch.testing.assert_close(found_coefficients, coefficients, rtol=0, atol=0)


def test_a_corrected_camera_is_weak_perspective():
    cameras, coefficients = fits()
    found, found_coefficients = changing()(levels(), cameras, coefficients)
    rotation, scale = rotation_and_scale(found)
    torch.testing.assert_close(rotation @ rotation.mT, torch.eye(3).expand(3, 3, 3), rtol=0, atol=1e-5)
    torch.testing.assert_close(found[:, :, :3], scale[:, None, None] * rotation[:, :2])
    assert (found - cameras).abs().amax() > 1e-3
    assert (found_coefficients - coefficients).abs().amax() > 1e-2


def test_each_fit_is_corrected_by_itself():
    cameras, coefficients = fits()
    correction = changing()
    together = correction(levels(), cameras, coefficients)
    alone = correction([level[1:2] for level in levels()], cameras[1:2], coefficients[1:2])
    for some, one in zip(together, alone, strict=True):
        torch.testing.assert_close(some[1:2], one, rtol=0, atol=1e-5)


def test_what_is_answered_are_changes_in_their_units():
    correction = changing()
    torch.nn.init.zeros_(correction.second.weight)
    torch.nn.init.zeros_(correction.second.bias)
    answered = torch.zeros(CAMERA_CHANGES + N_COEFFICIENTS)
    answered[[2, 3, 4, 5, 6]] = torch.tensor([math.pi / 2 / 0.1, math.log(2) / 0.05, 2.0, -1.0, 1.0])
    correction.second.bias.data.copy_(answered)
    cameras, coefficients = fits(1)
    found, changed = correction(levels(1), cameras, coefficients)
    # A quarter turn in the picture (x towards y), twice the size, a tenth of the side to the right, a twentieth up.
    expected = 2 * torch.stack((-cameras[0, 1, :3], cameras[0, 0, :3]))
    torch.testing.assert_close(found[0, :, :3], expected, rtol=1e-4, atol=1e-7)
    torch.testing.assert_close(found[0, :, 3], cameras[0, :, 3] + torch.tensor([0.1, -0.05]))
    torch.testing.assert_close(changed[0, 0] - coefficients[0, 0], torch.tensor(0.3))


@pytest.mark.parametrize("size", [1e-12, 1e-4, 0.3, 3.0])
def test_rotations_are_those_of_scipy(size):
    vectors = torch.randn(5, 3, generator=generator(), dtype=torch.float64) * size
    expected = Rotation.from_rotvec(vectors.numpy()).as_matrix()
    torch.testing.assert_close(rotation_of(vectors), torch.tensor(expected), rtol=0, atol=1e-12)


def test_the_gradient_is_finite_where_nothing_turns():
    vectors = torch.zeros(2, 3, requires_grad=True)
    rotation_of(vectors)[:, 0, 1].sum().backward()
    torch.testing.assert_close(vectors.grad, torch.tensor([[0.0, 0.0, -1.0]]).expand(2, 3))


def test_the_network_gives_the_features_that_it_goes_by():
    torch.manual_seed(0)
    network = ResidualUNet(residual_widths(4), 9, 68, N_COEFFICIENTS)
    assert correction_widths(residual_widths(4)) == LEVEL_WIDTHS
    pictures = torch.rand(2, 3, 128, 128, generator=generator()) - 0.5
    network(pictures)  # moves the statistics of its norms
    network.eval()
    planes, landmarks, found = network.read(pictures)
    assert [tuple(level.shape[1:]) for level in found] == [(16, 16, 16), (24, 8, 8), (32, 4, 4)]
    torch.testing.assert_close(network(pictures), (planes, landmarks), rtol=0, atol=0)
