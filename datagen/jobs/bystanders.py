"""Other people behind the one whose face a picture is about."""

from dataclasses import replace
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from datagen.appearance.backdrop.backdrop import PersonPlace
from datagen.appearance.backdrop.focus import defocused
from datagen.appearance.configuration import AppearanceConfig
from datagen.appearance.scene import Scene
from datagen.appearance.scene_making import SceneMaker
from datagen.appearance.whole import Appearance, draw_appearance
from datagen.random_streams import generator_for
from datagen.rendering.scene_drawing import SceneDrawer
from pix2face.camera import HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.coefficients import Face

# Sides of the pictures that bystanders are drawn in, before they are brought to size: few, as the drawer keeps buffers
# for each, and small, as they are out of focus.
SIDES_PX = (64, 128)
# What nobody sees of somebody out of focus.
UNSEEN = ("brows/", "lashes/", "jewellery/")
# What such a picture shows across, mm: head, hair and shoulders.
ACROSS_MM = 480.0
# How tall a head is beside a picture of its own size 1: the scale of a place is relative to the head in front, which
# takes about half of its picture.
FRONT_SHARE = 0.55
HEAD_MM = 240.0


@final
class Bystanders:
    """Draws people into backdrops.

    Args:
        scenes: Makes their scenes.
        drawer: Draws them.
        seed: Of the job.
        config: What they are drawn from.
    """

    def __init__(self, scenes: SceneMaker, drawer: SceneDrawer, seed: int, config: AppearanceConfig) -> None:
        self._scenes, self._drawer, self._seed, self._config = scenes, drawer, seed, config

    def draw(self, backdrop: Float32[ndarray, "h w 3"], appearance: Appearance, appearance_id: str) -> None:
        """Draws the people of an appearance's backdrop over it, in the same light.

        Args:
            backdrop: Linear light; is drawn into.
            appearance: Of the picture.
            appearance_id: What its random streams hang on.
        """
        for place in appearance.backdrop.people:
            self._draw_one(backdrop, place, appearance, f"{appearance_id}/bystander {place.seed}")

    def _draw_one(self, backdrop: Float32[ndarray, "h w 3"], place: PersonPlace, front: Appearance, name: str) -> None:
        height, width = backdrop.shape[:2]
        side = place.scale * FRONT_SHARE * width * ACROSS_MM / HEAD_MM
        # Pixels no wider than what one is out of focus by.
        wanted = side / (1 + place.blur * width)
        drawn_px = next((size for size in SIDES_PX if size >= wanted), SIDES_PX[-1])
        face = self._face(name, drawn_px)
        own = draw_appearance(self._seed, name, self._config)
        shown = Appearance(**{**vars(own), "light": front.light, "backdrop": front.backdrop})
        vertices = self._scenes.model.vertices(face.identity[None], face.expression[None])[0]
        scene = plainer(self._scenes.scene(shown, face, vertices))
        picture = self._drawer.draw(scene, face.camera, drawn_px, drawn_px)
        rgba = np.concatenate([picture.radiance, picture.coverage[..., None]], axis=2)
        placed = _placed(rgba, place, side / drawn_px, (height, width))
        soft = defocused(placed, place.blur * width)
        backdrop *= 1 - soft[..., 3:]
        backdrop += soft[..., :3]

    def _face(self, name: str, side_px: int) -> Face:
        rng = generator_for(self._seed, name)
        model = self._scenes.model
        yaw, pitch, roll = rng.normal(0, [35, 8, 6])
        rotation = rotation_of_pose(HeadPose(float(pitch), float(yaw), float(roll)))
        middle = np.array([side_px / 2, 0.45 * side_px])
        return Face(
            sample_id=name,
            identity=np.clip(rng.standard_normal(model.n_identity), -2.5, 2.5).astype(np.float32),
            expression=np.zeros(model.n_expression, np.float32),
            camera=weak_perspective_camera(WeakPerspective(side_px / ACROSS_MM, rotation, middle)),
            height_px=side_px,
            width_px=side_px,
        )


def plainer(scene: Scene) -> Scene:
    """A scene as it is drawn of somebody far away: without shadows and what is too small to be seen."""
    meshes = tuple(mesh for mesh in scene.meshes if not mesh.name.startswith(UNSEEN))
    return replace(scene, meshes=meshes, lights=np.zeros((0, 3), dtype=np.float32))


def _placed(
    rgba: Float32[ndarray, "s s 4"], place: PersonPlace, scale: float, size: tuple[int, int]
) -> Float32[ndarray, "h w 4"]:
    """A small picture at its place in a larger one; pixel centres at +0.5."""
    height, width = size
    half = len(rgba) / 2
    shift = np.array([place.x * width, place.y * height]) - scale * half
    matrix = np.array([[scale, 0, shift[0] + 0.5 * scale - 0.5], [0, scale, shift[1] + 0.5 * scale - 0.5]])
    kind = cv2.INTER_AREA if scale < 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.warpAffine(rgba, matrix, (width, height), flags=kind, borderValue=0), dtype=np.float32)
