"""Draws ``docs/images/builtin_faces.jpg``: random faces of the built-in model from three sides, with their landmarks.

python -m scripts.draw_builtin_faces [--faces 24] [--expressions] [--out FILE]
"""

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np
from numpy import ndarray

from datagen.appearance.plain_appearance import draw_plain_appearance
from datagen.opengl.gl_context import create_gl_context
from datagen.random_streams import generator_for
from datagen.rendering.renderer import Renderer, visible_landmarks
from datagen.sampling.faces import draw_expression
from pix2face.geometry.camera import HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.morphable_model import MorphableModel, open_model
from pix2face.models.rasterise import SURFACE_DEPTH

VIEWS = (HeadPose(0, 0, 0), HeadPose(0, 40, 0), HeadPose(0, 85, 0))
TILE_PX, PX_PER_MM = 170, 0.6
COLUMNS = 4


def main() -> int:
    """Draws the sheet."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faces", type=int, default=24)
    parser.add_argument("--expressions", action="store_true", help="with expressions instead of neutral")
    parser.add_argument("--model", default="builtin")
    parser.add_argument("--out", type=Path, default=Path("docs/images/builtin_faces.jpg"))
    options = parser.parse_args()
    model = open_model(options.model)
    with create_gl_context() as gl:
        renderer = Renderer(model, TILE_PX, TILE_PX, gl)
        strips = [draw_face(renderer, model, index, options.expressions) for index in range(options.faces)]
    rows = [np.hstack(strips[start : start + COLUMNS]) for start in range(0, len(strips), COLUMNS)]
    options.out.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(options.out), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 88])
    return 0


def draw_face(renderer: Renderer, model: MorphableModel, index: int, with_expression: bool) -> ndarray:
    """Draws one face from three sides, with visible landmarks in green and hidden ones in red."""
    rng = generator_for(0, f"sheet/{index}")
    identity = rng.standard_normal((1, model.n_identity))
    expression = draw_expression(model, rng)[None] * with_expression
    vertices = model.vertices(identity, expression)[0]
    appearance = draw_plain_appearance(rng)
    background = np.full((TILE_PX, TILE_PX, 3), 235, dtype=np.uint8)
    tiles = []
    for pose in VIEWS:
        pose_camera = WeakPerspective(PX_PER_MM, rotation_of_pose(pose), np.array([TILE_PX / 2, TILE_PX / 2 + 8]))
        camera = weak_perspective_camera(pose_camera)
        tile = renderer.render_image(vertices, camera, appearance, background)
        landmarks = model.landmarks[IBUG68]
        visible = visible_landmarks(vertices, landmarks, camera, renderer.render(vertices, camera)[SURFACE_DEPTH])
        for (x, y), seen in zip(camera.project(vertices[landmarks]), visible, strict=True):
            tile[int(y), int(x)] = (40, 255, 40) if seen else (255, 60, 60)
        tiles.append(tile)
    return np.hstack(tiles)


if __name__ == "__main__":
    sys.exit(main())
