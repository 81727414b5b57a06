"""Pictures for faces that have no photograph: plain ones, or synthetic photographs of people."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
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
from pix2face.models.rasterise import RenderedMaps
from pix2face.shards.layers import SEEN, SEEN_REGIONS
from pix2face.shards.triplet import PICTURE, PictureKind


@final
@dataclass(frozen=True, eq=False)
class DrawnPicture:
    """A picture of a face.

    Attributes:
        content: Of the file; None where no picture is wanted.
        attributes: What it was drawn from.
        layers: What stands before the face, by the layers' names.
    """

    content: bytes | None
    attributes: Mapping[str, str | float]
    layers: Mapping[str, ndarray] = field(default_factory=dict)


class PictureSource(ABC):
    """Draws pictures."""

    @abstractmethod
    def draw(
        self, view: View, vertices: Float32[ndarray, "v 3"], rendered: RenderedMaps, times: StageTimes
    ) -> DrawnPicture:
        """Draws one.

        Args:
            view: The face, and what its appearance hangs on.
            vertices: Of this face, mm, model frame.
            rendered: Its maps, with the layer ``regions`` where what is seen is asked for.
            times: Counts the stages.
        """


@final
class PlainPictures(PictureSource):
    """Heads painted region by region, for any model.

    Args:
        renderer: Of the model.
        seed: Of everything random.
    """

    def __init__(self, renderer: Renderer, seed: int) -> None:
        self._renderer, self._seed = renderer, seed

    def draw(
        self, view: View, vertices: Float32[ndarray, "v 3"], rendered: RenderedMaps, times: StageTimes
    ) -> DrawnPicture:
        """Draws one; nothing stands before its face."""
        face = view.face
        with times.stage("draw picture"):
            rng = generator_for(self._seed, view.appearance_id)
            appearance = draw_plain_appearance(rng)
            background = draw_background(rng, face.height_px, face.width_px)
            renderer = self._renderer.with_size(face.height_px, face.width_px)
            picture = renderer.render_image(vertices, face.camera, appearance, background)
            shown = view.jittered_colours(develop_plain(picture, appearance))
            return DrawnPicture(encode_photograph(shown), {PICTURE: PictureKind.PLAIN})


@final
class ScenePictures(PictureSource):
    """Synthetic photographs of people with the built-in model's heads.

    Args:
        model: The built-in model.
        gl: Where to draw.
        seed: Of everything random.
        config: What is drawn from.
    """

    def __init__(self, model: MorphableModel, gl: GLContext, seed: int, config: AppearanceConfig) -> None:
        self._model, self._seed, self._config = model, seed, config
        self._scenes = SceneMaker(model)
        self._drawer = SceneDrawer(model, gl, appearance_textures(), head_paint(model), head_occlusion(model))
        self._bystanders = Bystanders(self._scenes, self._drawer, seed, config)

    def draw(
        self, view: View, vertices: Float32[ndarray, "v 3"], rendered: RenderedMaps, times: StageTimes
    ) -> DrawnPicture:
        """Draws one, with what stands before its face."""
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
        layers = self._seen(picture, rendered, appearance)
        n_face = max(int(rendered.mask.sum()), 1)
        attributes = {
            PICTURE: PictureKind.SYNTHETIC,
            "seen_share": round(float(layers[SEEN].sum() / n_face), 4),
            **appearance_attributes(appearance),
        }
        return DrawnPicture(content, attributes, layers)

    def _seen(self, picture: ScenePicture, rendered: RenderedMaps, appearance: Appearance) -> dict[str, ndarray]:
        """Heads are where the exact rasteriser has them; the scene says what is before them."""
        is_before = picture.labels > HEAD
        beyond = beyond_border(appearance.photograph.border, *rendered.mask.shape)
        layers = {SEEN: rendered.mask & ~is_before & ~beyond}
        regions = rendered.extra.get("regions")
        if regions is not None:
            n_model = len(self._model.region_names)
            seen = np.where(is_before, picture.labels.astype(np.uint8) + np.uint8(n_model - HEAD), regions)
            layers[SEEN_REGIONS] = np.where(beyond, np.uint8(0), seen)
        return layers
