"""Faces to triplets: geometry, layers, picture, landmarks."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import final

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from datagen.appearance.background import draw_background
from datagen.appearance.plain import develop, draw_plain_appearance
from datagen.jobs.baked_jitter import View
from datagen.jobs.stage_times import StageTimes
from datagen.opengl.gl_context import GLContext
from datagen.random_streams import generator_for
from datagen.rendering.renderer import Renderer
from datagen.rendering.visibility import visible_landmarks
from pix2face.camera import head_pose
from pix2face.coefficients import Face
from pix2face.errors import DegenerateGeometryError, InputFileError, SampleRejectedError, UsageError
from pix2face.images import decode_image, encode_photograph, read_bytes
from pix2face.landmarks import IBUG68
from pix2face.morphable_model import MorphableModel
from pix2face.picture_size import check_decodes
from pix2face.rasterise import RenderedMaps
from pix2face.shards.layers import DEFAULT_LAYERS, IMAGE, LANDMARKS, LAYERS
from pix2face.shards.shard_reader import Triplet
from pix2face.surface_attributes import check_layers


@final
class TripletMaker:
    """Turns faces of one model into triplets.

    Args:
        model: The model of the faces.
        gl: Where to render.
        seed: Of everything random in a picture.
        layers: What triplets have, of ``pix2face.shards.layers.LAYER_NAMES``.

    Raises:
        UsageError: The model has not what a layer needs.
    """

    def __init__(self, model: MorphableModel, gl: GLContext, seed: int, layers: Sequence[str] = DEFAULT_LAYERS) -> None:
        check_layers(model, layers)
        self._model = model
        self._renderer = Renderer(model, 16, 16, gl)
        self._seed = seed
        self._layers = tuple(layers)

    def make(self, face: Face) -> Triplet:
        """Renders one face as its source has it.

        Raises:
            SampleRejectedError: Nothing of the face is in the picture, it is partly behind the camera, its
                photograph cannot be read, or the picture is larger than the driver can draw.
        """
        (made,) = self.make_all([View(face, face.sample_id)], StageTimes())
        if isinstance(made, SampleRejectedError):
            raise made
        return made

    def make_all(self, views: Sequence[View], times: StageTimes) -> Iterator[Triplet | SampleRejectedError]:
        """Renders views whose geometry is computed together.

        Args:
            views: Some; their vertices are in memory at the same time.
            times: Counts the stages.

        Yields:
            For each view its triplet, or why there is none, as in ``make``.
        """
        if not views:
            return
        with times.stage("geometry"):
            batch = self._geometry([view.face for view in views])
        for view, vertices in zip(views, batch, strict=True):
            try:
                yield self._make(view, vertices, times)
            except SampleRejectedError as error:
                yield error
            except (DegenerateGeometryError, InputFileError, UsageError) as error:
                yield SampleRejectedError(f"{view.face.sample_id}: {error}")

    def _geometry(self, faces: Sequence[Face]) -> Float32[ndarray, "n v 3"]:
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is rejected when it is drawn
            return self._model.vertices(
                np.stack([face.identity for face in faces]), np.stack([face.expression for face in faces])
            )

    def _make(self, view: View, vertices: Float32[ndarray, "v 3"], times: StageTimes) -> Triplet:
        face = view.face
        with times.stage("rasterise, read back"):
            renderer = self._renderer.with_size(face.height_px, face.width_px)
            rendered = renderer.render(vertices, face.camera, self._layers)
        if not rendered.mask.any():
            raise SampleRejectedError(f"{face.sample_id}: nothing of the face lies in the picture")
        image, drawn = self._image(view, renderer, vertices, times)
        with times.stage("landmarks, pose"):
            landmarks = self._model.landmarks.get(IBUG68, np.zeros(0, np.int32))
            if LANDMARKS not in self._layers:
                landmarks = landmarks[:0]
            landmarks3d = vertices[landmarks]
            return Triplet(
                sample_id=face.sample_id,
                image=image,
                layers=_layers(rendered, self._layers),
                camera=face.camera,
                identity=face.identity,
                expression=face.expression,
                landmarks2d=face.camera.project(landmarks3d),
                landmarks3d=landmarks3d,
                visible=visible_landmarks(vertices, landmarks, face.camera, rendered),
                attributes={**asdict(head_pose(face.camera)), **face.attributes, **drawn},
            )

    def _image(
        self, view: View, renderer: Renderer, vertices: Float32[ndarray, "v 3"], times: StageTimes
    ) -> tuple[bytes | None, dict[str, str | float]]:
        """The photograph's own bytes, what a variant shows of it, or a picture of the face."""
        face = view.face
        if face.image_path is not None:
            # A photograph that is damaged rejects its sample also where pictures are not kept: which samples a set
            # has does not depend on its layers.
            with times.stage("read, check photograph"):
                content = read_bytes(face.image_path)
                if view.crop is None:
                    check_decodes(content, str(face.image_path))
                else:
                    content = encode_photograph(view.jittered_photograph(decode_image(content, str(face.image_path))))
            return content, {"picture": "photograph"}
        if IMAGE not in self._layers:
            return None, {}
        with times.stage("draw picture"):
            rng = generator_for(self._seed, view.appearance_id)
            appearance = draw_plain_appearance(rng)
            background = draw_background(rng, face.height_px, face.width_px)
            picture = renderer.render_image(vertices, face.camera, appearance, background)
            shown = view.jittered_colours(develop(picture, appearance))
            return encode_photograph(shown), {"picture": "rendered"}


def _layers(rendered: RenderedMaps, names: Sequence[str]) -> dict[str, ndarray]:
    return {name: rendered.layer(name) for name in names if name in LAYERS}
