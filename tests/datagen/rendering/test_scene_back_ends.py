"""The same scene drawn by both back ends."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.gl

SIZE = 128
DRAW = """
import sys
import numpy as np
from datagen.appearance.scene import Texture
from datagen.opengl.gl_context import create_gl_context
from pix2face.errors import GLUnavailableError
from pix2face.models.morphable_model import builtin_model
from tests.datagen.rendering.plain_scenes import LAMBERT, ball, camera_at, plain_drawer, scene_of, sheet
try:
    gl = create_gl_context()
except GLUnavailableError as error:
    sys.exit(f"not here: {error}")
model, rng, size = builtin_model(), np.random.default_rng(0), int(sys.argv[2])
paint = rng.uniform(0.2, 0.8, size=(len(model.mean), 8)).astype(np.float32)
pixels = rng.integers(0, 256, size=(1, 64, 64, 4)).astype(np.uint8)
meshes = [
    ball((60, 60, 90), 25, colour=(0.8, 0.3, 0.2)),
    ball((0, 60, 0), 110, "hair", kind="hair", texture="hair_cards", is_blended=True, colour=(0.3, 0.2, 0.1)),
    sheet(130, (-60, 60, 10, 40), alpha=0.3, colour=(0.1, 0.1, 0.1)),
]
pictures = []
with plain_drawer(model, gl, LAMBERT, {"hair_cards": Texture(pixels=pixels)}, paint) as drawer:
    for yaw, pitch, distance in ((0, 0, None), (50, 20, 500), (-85, -10, 800)):
        scene = scene_of(model, meshes, [(0.5, 0.4, 0.7), (-1, 0.2, 0.2), (0, 1, 0)])
        pictures.append(drawer.draw(scene, camera_at(yaw, pitch, size, distance), size, size))
np.savez(sys.argv[1], **{n: np.stack([getattr(p, n) for p in pictures]) for n in ("radiance", "coverage", "labels")})
"""


def drawn_by(backend: str, out: Path) -> dict[str, np.ndarray]:
    environment = {**os.environ, "PIX2FACE_GL": backend, "PYTHONPATH": "."}
    command = [sys.executable, "-W", "error", "-c", DRAW, str(out), str(SIZE)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=Path(__file__).parents[3])
    if done.returncode and "not here" in done.stderr:
        pytest.skip(f"{backend}: {done.stderr.strip()}")
    assert done.returncode == 0, done.stderr
    with np.load(out, allow_pickle=False) as arrays:
        return dict(arrays)


def shown(radiance: np.ndarray) -> np.ndarray:
    """sRGB, 0..255."""
    linear = np.clip(radiance, 0, 1)
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def test_both_back_ends_draw_the_same(tmp_path: Path) -> None:
    egl, osmesa = (drawn_by(backend, tmp_path / f"{backend}.npz") for backend in ("egl", "osmesa"))
    difference = np.abs(shown(egl["radiance"]) - shown(osmesa["radiance"])).max(axis=-1)
    assert (difference <= 2).mean() >= 0.999
    assert (np.abs(egl["coverage"] - osmesa["coverage"]) <= 2 / 255).mean() >= 0.999
    assert (egl["labels"] == osmesa["labels"]).mean() >= 0.999
    assert set(np.unique(egl["labels"])) == {0, 1, 2, 9}
