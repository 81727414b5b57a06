"""Other people behind the one whose face a picture is about.

To draw somebody far away takes nearly as long as to draw whoever stands in front. So a job has a few dozen people, whom
each worker draws once, in even light; what one of them adds to a picture is as bright and of the colour as its light.
"""

from dataclasses import replace
from functools import lru_cache
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from datagen.appearance.appearance import Appearance, draw_appearance
from datagen.appearance.appearance_config import AppearanceConfig
from datagen.appearance.backdrop.backdrop import PersonPlace
from datagen.appearance.light.light_sources import seen_light
from datagen.appearance.photograph.lens import defocused
from datagen.appearance.scene import Scene
from datagen.appearance.scene_making import SceneMaker
from datagen.random_streams import generator_for
from datagen.rendering.scenes.scene_drawing import SceneDrawer
from pix2face.face_files.coefficients import Face
from pix2face.geometry.camera import HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera

# Of a job.
N_PEOPLE = 32
# Sides of the picture that a bystander is drawn in, and of what is left of it for whoever is farther away: small, as
# they are out of focus.
DRAWN_PX, HALVED_PX = 128, 64
# What nobody sees of somebody out of focus.
UNSEEN = ("brows/", "lashes/", "jewellery/")
# What such a picture shows across, mm: head, hair and shoulders.
ACROSS_MM = 480.0
# How tall a head is beside a picture of its own size 1: the scale of a place is relative to the head in front, which
# takes about half of its picture.
FRONT_SHARE = 0.55
HEAD_MM = 240.0
# Harmonics of even light, which comes a little more from above and from the camera's side; camera frame.
_EVEN_LIGHT = (1.0, 0.0, -0.45, -0.25, 0.0, 0.0, 0.0, 0.0, 0.0)


@final
class Bystanders:
    """Draws people into backdrops."""

    def __init__(self, scenes: SceneMaker, drawer: SceneDrawer, seed: int, config: AppearanceConfig) -> None:
        self._scenes, self._drawer, self._seed, self._config = scenes, drawer, seed, config
        self._picture = lru_cache(maxsize=N_PEOPLE)(self._drawn)

    def draw(self, backdrop: Float32[ndarray, "h w 3"], appearance: Appearance) -> None:
        """Draws the people of an appearance into its backdrop (linear light), as bright as its light."""
        if appearance.backdrop.people:
            white = seen_light(appearance.light).astype(np.float32)
            for place in appearance.backdrop.people:
                self._place_one(backdrop, place, white)

    def _place_one(self, backdrop: Float32[ndarray, "h w 3"], place: PersonPlace, white: Float32[ndarray, "3"]) -> None:
        height, width = backdrop.shape[:2]
        side = place.scale * FRONT_SHARE * width * ACROSS_MM / HEAD_MM
        rgba = self._picture(place.seed % N_PEOPLE)
        # Pixels no wider than what one is out of focus by.
        if side / (1 + place.blur * width) <= HALVED_PX:
            rgba = cv2.resize(rgba, (HALVED_PX, HALVED_PX), interpolation=cv2.INTER_AREA)
        soft = defocused(_placed(rgba, place, side / len(rgba), (height, width)), place.blur * width)
        backdrop *= 1 - soft[..., 3:]
        backdrop += soft[..., :3] * white

    def _drawn(self, number: int) -> Float32[ndarray, "s s 4"]:
        """One of the people: radiance multiplied by coverage, as where a white ball shows 1, and coverage."""
        name = f"bystander {number}"
        face = self._face(name)
        own = draw_appearance(self._seed, name, self._config)
        even = tuple(harmonic for harmonic in _EVEN_LIGHT for _ in range(3))
        light = replace(own.light, lamps=(), panoramas=(), gobo=None, ambient=even)
        vertices = self._scenes.model.vertices(face.identity[None], face.expression[None])[0]
        scene = plainer(self._scenes.scene(replace(own, light=light), face, vertices))
        picture = self._drawer.draw(scene, face.camera, DRAWN_PX, DRAWN_PX)
        radiance = picture.radiance / seen_light(light).astype(np.float32)
        return np.concatenate([radiance, picture.coverage[..., None]], axis=2)

    def _face(self, name: str) -> Face:
        rng = generator_for(self._seed, name)
        model = self._scenes.model
        yaw, pitch, roll = rng.normal(0, [35, 8, 6])
        rotation = rotation_of_pose(HeadPose(float(pitch), float(yaw), float(roll)))
        middle = np.array([DRAWN_PX / 2, 0.45 * DRAWN_PX])
        return Face(
            sample_id=name,
            identity=np.clip(rng.standard_normal(model.n_identity), -2.5, 2.5).astype(np.float32),
            expression=np.zeros(model.n_expression, np.float32),
            camera=weak_perspective_camera(WeakPerspective(DRAWN_PX / ACROSS_MM, rotation, middle)),
            height_px=DRAWN_PX,
            width_px=DRAWN_PX,
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
