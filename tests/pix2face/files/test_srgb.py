import numpy as np
import pytest

from pix2face.files.images import linear_to_srgb, srgb_to_linear


@pytest.mark.parametrize(("stored", "light"), [(0.0, 0.0), (0.02, 0.02 / 12.92), (0.5, 0.214041), (1.0, 1.0)])
def test_known_values(stored: float, light: float) -> None:
    assert srgb_to_linear(np.array([stored]))[0] == pytest.approx(light, abs=1e-6)
    assert linear_to_srgb(np.array([light]))[0] == pytest.approx(stored, abs=1e-6)


def test_there_and_back_without_a_step_where_the_branches_meet() -> None:
    light = np.linspace(0, 1, 10_001)
    np.testing.assert_allclose(srgb_to_linear(linear_to_srgb(light)), light, atol=1e-6)
    assert np.diff(linear_to_srgb(light)).min() > 0
    assert srgb_to_linear(np.zeros(1, dtype=np.float32)).dtype == np.float32
