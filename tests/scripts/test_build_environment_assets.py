"""What the script stores of a panorama gives the panorama back."""

import base64
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from scripts.build_environment_assets import GAIN_STOPS, read_panorama, split_gain


def test_colours_and_gain_make_up_the_panorama() -> None:
    rng = np.random.default_rng(0)
    panorama = np.exp(rng.uniform(-4, 9, size=(40, 60, 3))).astype(np.float32)
    srgb, gain = split_gain(panorama)
    assert (gain[panorama.max(axis=2) <= 1] == 0).all()
    below = srgb.astype(np.float64) / 255
    linear = np.where(below <= 0.04045, below / 12.92, ((below + 0.055) / 1.055) ** 2.4)
    found = linear * np.exp2(gain[..., None] / 255 * GAIN_STOPS)
    brightest = panorama.max(axis=2)
    np.testing.assert_allclose(found.max(axis=2)[brightest > 0.1], brightest[brightest > 0.1], rtol=0.03)
    assert np.abs(found - panorama).mean() < 0.01 * panorama.mean()


def test_an_exr_inside_javascript_is_read(tmp_path: Path) -> None:
    pixels = np.linspace(-0.5, 100, 8 * 16 * 3, dtype=np.float32).reshape(8, 16, 3)
    exr = tmp_path / "p.exr"
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"RGB": pixels}) as file:
        file.write(str(exr))
    script = tmp_path / "p.exr.js"
    text = base64.b64encode(exr.read_bytes()).decode()
    script.write_text(f"export default 'data:application/exr;base64,{text}'", encoding="ascii")
    np.testing.assert_array_equal(read_panorama(script), pixels)
    script.write_text("export default 'nothing'", encoding="ascii")
    with pytest.raises(SystemExit, match="expected an EXR"):
        read_panorama(script)
