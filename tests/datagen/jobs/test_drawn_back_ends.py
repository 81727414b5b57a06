"""Whole synthetic photographs, with the shaders that they are drawn with, by both back ends."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pix2face.shards.layers import LAYERS

pytestmark = [pytest.mark.gl, pytest.mark.xdist_group("drawn_back_ends")]  # the pictures are drawn once

SIZE, N = 96, 10
# Light as it falls, before noise could hide differences, and the bytes that it becomes before they are a file.
DRAW = """
import sys
import numpy as np
from pathlib import Path
from datagen.appearance.appearance_config import DEFAULT, PRESETS
from datagen.appearance.light.shading import head_occlusion
from datagen.appearance.scene_making import SceneMaker
from datagen.appearance.skin.zones import head_paint
from datagen.appearance.appearance import appearance_textures, draw_appearance
from datagen.opengl.gl_context import create_gl_context
from datagen.rendering.renderer import Renderer
from datagen.appearance.backdrop.backdrop import backdrop_pixels
from datagen.appearance.photograph.photograph import develop
from datagen.appearance.scene import HEAD
from datagen.samples.bystanders import Bystanders
from datagen.rendering.scenes.scene_drawing import SceneDrawer
from datagen.sampling.faces import sample_faces
from pix2face.errors import GLUnavailableError
from pix2face.models.morphable_model import builtin_model
try:
    gl = create_gl_context()
except GLUnavailableError as error:
    sys.exit(f"not here: {error}")
out, size, n = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
model, config, found = builtin_model(), PRESETS[DEFAULT], {}
table = sample_faces(model, n, 2, size, config.geometry)
scenes, renderer = SceneMaker(model), Renderer(model, size, size, gl)
drawer = SceneDrawer(model, gl, appearance_textures(), head_paint(model), head_occlusion(model))
bystanders = Bystanders(scenes, drawer, 4, config)
for index, vertices in enumerate(model.vertices(table.identity, table.expression)):
    face = table.face(index, Path("."))
    appearance = draw_appearance(4, str(index), config)
    picture = drawer.draw(scenes.scene(appearance, face, vertices), face.camera, size, size)
    light = backdrop_pixels(appearance.backdrop, face.camera, size, size, "")
    bystanders.draw(light, appearance)
    light = light * (1 - picture.coverage[..., None]) + picture.radiance
    found.setdefault("developed", []).append(develop(light, appearance.photograph, picture.labels == HEAD))
    maps = renderer.render(vertices, face.camera, ("normals", "regions"))
    for name in ("radiance", "coverage", "labels"):
        found.setdefault(name, []).append(getattr(picture, name))
    for name in ("pncc", "offset", "mask", "depth", "normals", "regions"):
        found.setdefault(name, []).append(maps[name])
np.savez(out, **{name: np.stack(values) for name, values in found.items()})
"""


def drawn_by(backend: str, out: Path) -> dict[str, np.ndarray]:
    environment = {**os.environ, "PIX2FACE_GL": backend, "PYTHONPATH": "."}
    command = [sys.executable, "-W", "error", "-c", DRAW, str(out), str(SIZE), str(N)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=Path(__file__).parents[3])
    if done.returncode and "not here" in done.stderr:
        pytest.skip(f"{backend}: {done.stderr.strip()}")
    assert done.returncode == 0, done.stderr
    with np.load(out, allow_pickle=False) as arrays:
        return dict(arrays)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    folder = tmp_path_factory.mktemp("drawn")
    return drawn_by("egl", folder / "egl.npz"), drawn_by("osmesa", folder / "osmesa.npz")


def shown(radiance: np.ndarray) -> np.ndarray:
    """sRGB, 0..255."""
    linear = np.clip(radiance, 0, 1)
    return 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def test_both_back_ends_draw_the_same_photograph(both: tuple[dict[str, np.ndarray], dict[str, np.ndarray]]) -> None:
    egl, osmesa = both
    difference = np.abs(shown(egl["radiance"]) - shown(osmesa["radiance"])).max(axis=-1)
    assert egl["radiance"].std() > 0.02  # something is there
    assert (difference <= 2).mean() >= 0.999
    assert (np.abs(egl["coverage"] - osmesa["coverage"]) <= 2 / 255).mean() >= 0.999
    assert (egl["labels"] == osmesa["labels"]).mean() >= 0.999
    assert {0, 1, 2} < set(np.unique(egl["labels"]))


def test_both_back_ends_render_the_same_maps(both: tuple[dict[str, np.ndarray], dict[str, np.ndarray]]) -> None:
    egl, osmesa = both
    in_both = egl["mask"] & osmesa["mask"]
    assert in_both.sum() > 1000 * N
    assert (egl["mask"] != osmesa["mask"]).sum() <= 2
    assert (egl["regions"] != osmesa["regions"])[in_both].sum() <= 2
    for name in ("pncc", "offset", "depth", "normals"):
        steps = [np.round(maps[name].astype(np.float64) * LAYERS[name].steps_per_unit)[in_both] for maps in both]
        assert np.abs(steps[0] - steps[1]).max() <= 1, name


def test_both_back_ends_give_the_same_bytes(both: tuple[dict[str, np.ndarray], dict[str, np.ndarray]]) -> None:
    difference = np.abs(np.subtract(*(own["developed"].astype(int) for own in both))).max(axis=-1)
    assert (difference <= 2).mean() >= 0.999
