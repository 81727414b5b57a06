"""Pictures for faces that have no photograph: plain ones, or synthetic photographs of people."""

from dataclasses import replace
from typing import final

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from datagen.appearance.appearance import Appearance, appearance_attributes, appearance_textures, draw_appearance
from datagen.appearance.appearance_config import AppearanceConfig
from datagen.appearance.backdrop.backdrop import backdrop_pixels
from datagen.appearance.backdrop.patterns import draw_background
from datagen.appearance.light.shading import head_occlusion
from datagen.appearance.photograph.border import beyond_border
from datagen.appearance.photograph.photograph import develop, encode
from datagen.appearance.plain_appearance import develop as develop_plain
from datagen.appearance.plain_appearance import draw_plain_appearance
from datagen.appearance.scene import HEAD, ScenePicture
from datagen.appearance.scene_making import SceneMaker
from datagen.appearance.skin.zones import head_paint
from datagen.opengl.gl_context import GLContext
from datagen.random_streams import generator_for
from datagen.rendering.renderer import Renderer
from datagen.rendering.scenes.scene_drawing import SceneDrawer
from datagen.samples.baked_jitter import View
from datagen.samples.bystanders import Bystanders
from datagen.samples.stage_times import StageTimes
from pix2face.files.images import encode_photograph
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.surface_attributes import REGIONS
from pix2face.shards.layers import COVERAGE, SEEN, SEEN_REGIONS
from pix2face.shards.sample import MASK, PICTURE, PictureKind, Sample


@final
class PlainPictures:
    """Heads painted region by region, for any model."""

    def __init__(self, renderer: Renderer, seed: int) -> None:
        self._renderer, self._seed = renderer, seed

    def draw(self, sample: Sample, view: View, vertices: Float32[ndarray, "v 3"], times: StageTimes) -> Sample:
        """Adds the picture of a face that nothing stands in front of; its vertices are in mm, model frame."""
        face = view.face
        with times.stage("draw picture"):
            rng = generator_for(self._seed, view.appearance_id)
            appearance = draw_plain_appearance(rng)
            background = draw_background(rng, face.height_px, face.width_px)
            renderer = self._renderer.with_size(face.height_px, face.width_px)
            picture = renderer.render_image(vertices, face.camera, appearance, background)
            shown = view.jittered_colours(develop_plain(picture, appearance))
            attributes = {**sample.attributes, PICTURE: PictureKind.PLAIN}
            return replace(sample, image_bytes=encode_photograph(shown), attributes=attributes)


@final
class ScenePictures:
    """Synthetic photographs of people with the built-in model's heads."""

    def __init__(self, model: MorphableModel, gl: GLContext, seed: int, config: AppearanceConfig) -> None:
        self._model, self._seed, self._config = model, seed, config
        self._scenes = SceneMaker(model)
        self._drawer = SceneDrawer(model, gl, appearance_textures(), head_paint(model), head_occlusion(model))
        self._bystanders = Bystanders(self._scenes, self._drawer, seed, config)

    def draw(self, sample: Sample, view: View, vertices: Float32[ndarray, "v 3"], times: StageTimes) -> Sample:
        """Adds the picture, and the layers that say what stands in front of the face and of the backdrop.

        The sample has its mask, and ``regions`` where ``seen_regions`` is wanted; vertices are in mm, model frame.
        """
        face = view.face
        size = (face.height_px, face.width_px)
        with times.stage("appearance, meshes"):
            appearance = draw_appearance(self._seed, view.appearance_id, self._config)
            scene = self._scenes.scene(appearance, face, vertices)
        with times.stage("draw scene"):
            picture = self._drawer.draw(scene, face.camera, *size)
        with times.stage("draw backdrop"):
            folder = self._config.backdrop.folder
            backdrop = backdrop_pixels(appearance.backdrop, face.camera, *size, folder)
            self._bystanders.draw(backdrop, appearance)
            backdrop *= 1 - picture.coverage[..., None]
            backdrop += picture.radiance
        with times.stage("develop, encode"):
            shown = view.jittered_colours(develop(backdrop, appearance.photograph, picture.labels == HEAD))
            content = encode(shown, appearance.photograph)
        layers = self._seen(picture, sample, appearance)
        n_face = max(int(sample.layers[MASK].sum()), 1)
        attributes = {
            **sample.attributes,
            PICTURE: PictureKind.SYNTHETIC,
            "seen_share": round(float(layers[SEEN].sum() / n_face), 4),
            **appearance_attributes(appearance),
        }
        return replace(sample, image_bytes=content, attributes=attributes, layers={**sample.layers, **layers})

    def _seen(self, picture: ScenePicture, sample: Sample, appearance: Appearance) -> dict[str, ndarray]:
        """The head is where the exact rasteriser has it; the scene says what stands before it and the backdrop."""
        mask, is_before = sample.layers[MASK], picture.labels > HEAD
        beyond = beyond_border(appearance.photograph.border, *mask.shape)
        layers = {SEEN: mask & ~is_before & ~beyond, COVERAGE: np.where(beyond, np.float32(0), picture.coverage)}
        regions = sample.layers.get(REGIONS)
        if regions is not None:
            n_model = len(self._model.region_names)
            seen = np.where(is_before, picture.labels.astype(np.uint8) + np.uint8(n_model - HEAD), regions)
            layers[SEEN_REGIONS] = np.where(beyond, np.uint8(0), seen)
        return layers
