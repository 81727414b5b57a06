"""The correction of fits in NumPy changes what the one that is trained changes."""

import numpy as np
import pytest
import torch

from pix2face.geometry.camera import HeadPose, WeakPerspective, affine_camera, rotation_of_pose, weak_perspective_camera
from pix2face.inference.fit_correction import FitCorrection, camera_of_rows, centred_rows
from pix2face.inference.weight_files import Weights
from pix2face.networks import correction as trained_correction
from pix2face.networks.dimensions import CORRECTION_PLACES, CORRECTION_WIDTHS

N_COEFFICIENTS, SIZE_PX = 7, 80


def trained() -> trained_correction.FitCorrection:
    """A correction whose weights and norms all count."""
    torch.manual_seed(0)
    network = trained_correction.FitCorrection((8, 12, 16), N_COEFFICIENTS)
    torch.nn.init.normal_(network.second.weight, std=0.1)
    torch.nn.init.normal_(network.second.bias, std=0.1)
    for norm in (network.fact_norm, network.first_norm):
        torch.nn.init.normal_(norm.running_mean, std=0.3)
        torch.nn.init.uniform_(norm.running_var, 0.01, 2)
    torch.nn.init.uniform_(network.first_norm.weight, 0.5, 1.5)
    torch.nn.init.normal_(network.first_norm.bias)
    return network.eval()


def in_use(network: trained_correction.FitCorrection) -> FitCorrection:
    arrays = {f"correction.{name}": own.numpy() for name, own in network.state_dict().items()}
    return FitCorrection.of(Weights(arrays), N_COEFFICIENTS)


@pytest.mark.parametrize("seed", range(5))
def test_it_changes_cameras_and_coefficients_as_the_trained_one_does(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = HeadPose(*rng.uniform(-60, 60, 3))
    camera = weak_perspective_camera(WeakPerspective(0.3, rotation_of_pose(pose), rng.uniform(30, 50, 2)))
    coefficients = rng.normal(size=N_COEFFICIENTS) * 3  # some facts are out of bounds
    seen = rng.normal(size=CORRECTION_WIDTHS[-1] * CORRECTION_PLACES**2).astype(np.float32)
    network = trained()
    found, changed = in_use(network).corrected(seen, camera, coefficients, SIZE_PX)
    with torch.no_grad():
        rows, expected = network.corrected(
            *(torch.from_numpy(values[None]).float() for values in (seen, centred_rows(camera, SIZE_PX), coefficients))
        )
    wanted = camera_of_rows(rows[0].double().numpy(), SIZE_PX)
    np.testing.assert_allclose(found.matrix, wanted.matrix, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(changed, expected[0].numpy(), rtol=1e-4, atol=1e-5)
    assert np.abs(found.matrix - camera.matrix).max() > 1e-2
    assert np.abs(changed - coefficients).max() > 1e-2


def test_rows_of_a_camera_are_in_units_of_the_crop_from_its_middle() -> None:
    camera = affine_camera(np.array([[0.5, 0.1, 0.0, 40.0], [0.0, -0.5, 0.2, 10.0]]))
    rows = centred_rows(camera, SIZE_PX)
    points = np.array([[1.0, 2.0, 3.0], [-30.0, 20.0, 0.0]])
    np.testing.assert_allclose(points @ rows[:, :3].T + rows[:, 3], camera.project(points) / SIZE_PX - 0.5)
    np.testing.assert_allclose(camera_of_rows(rows, SIZE_PX).matrix, camera.matrix, atol=1e-12)
