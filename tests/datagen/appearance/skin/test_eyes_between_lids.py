"""Eyeballs stay between their lids, whichever way a head is turned."""

import cv2
import numpy as np
import pytest
from numpy import ndarray

from datagen.appearance.appearance_config import HARD, PRESETS
from datagen.opengl.gl_context import GLContext
from datagen.rendering.renderer import Renderer
from datagen.sampling.faces import sample_faces
from pix2face.models.morphable_model import builtin_model
from tests.datagen.rendering.plain_scenes import camera_at

pytestmark = pytest.mark.gl

MODEL = builtin_model()
EYES = [1 + MODEL.region_names.index(name) for name in ("eyes", "iris", "pupil")]
SIZE, N_FACES, PX_PER_MM = 384, 20, 1.5
# A cornea is some 12 mm wide, and of the far eye its middle may be what is seen against the background.
LONGEST_MM = 6.0


def eyes_at_the_outline(renderer: Renderer, vertices: ndarray, yaw_deg: float) -> tuple[float, float]:
    """How many mm2 of eyes are seen, and how many mm of the head's outline they form."""
    camera = camera_at(yaw_deg, 0, SIZE, px_per_mm=PX_PER_MM / SIZE)
    maps = renderer.render(vertices, camera, ("regions",))
    eyes = np.isin(maps["regions"], EYES)
    behind = (~np.isfinite(maps["surface_depth"])).astype(np.uint8)
    at_outline = eyes & (cv2.dilate(behind, np.ones((3, 3), np.uint8)) > 0)
    return eyes.sum() / PX_PER_MM**2, at_outline.sum() / PX_PER_MM


@pytest.mark.parametrize("yaw_deg", [60, -60, 90, -90])
def test_of_eyeballs_no_more_than_the_cornea_is_at_the_outline(gl: GLContext, yaw_deg: float) -> None:
    """Of people drawn with the strongest expressions there are: eyes wide open, shut, turned, squinting."""
    renderer = Renderer(MODEL, SIZE, SIZE, gl)
    table = sample_faces(MODEL, N_FACES, 3, SIZE, PRESETS[HARD].geometry)
    heads = MODEL.vertices(table.identity, table.expression)
    found = np.array([eyes_at_the_outline(renderer, vertices, yaw_deg) for vertices in heads])
    assert found[:, 0].mean() > 5
    assert found[:, 1].max() <= LONGEST_MM


def test_an_eyeball_before_its_lids_is_noticed(gl: GLContext) -> None:
    """From the side the bridge of the nose hides an eye that is only a little too far out."""
    vertices = MODEL.mean.copy()
    of_eyes = np.isin(MODEL.triangle_regions, np.array(EYES) - 1)
    vertices[np.unique(MODEL.triangles[of_eyes])] += np.array([0, 0, 8], dtype=np.float32)
    assert eyes_at_the_outline(Renderer(MODEL, SIZE, SIZE, gl), vertices, 60)[1] > LONGEST_MM
