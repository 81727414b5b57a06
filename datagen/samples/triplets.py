"""Faces to triplets: geometry, layers, picture, landmarks."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import final

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from datagen.appearance.appearance_config import PLAIN, PRESETS, AppearanceConfig
from datagen.opengl.gl_context import GLContext
from datagen.rendering.renderer import Renderer, visible_landmarks
from datagen.samples.baked_jitter import View
from datagen.samples.drawn_pictures import DrawnPicture, PictureSource, PlainPictures, ScenePictures
from datagen.samples.stage_times import StageTimes
from pix2face.errors import DegenerateGeometryError, InputFileError, SampleRejectedError, UsageError
from pix2face.face_files.coefficients import Face
from pix2face.files.images import check_decodes, decode_image, encode_photograph, read_bytes
from pix2face.geometry.camera import head_pose
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.morphable_model import MorphableModel, builtin_model
from pix2face.models.rasterise import RenderedMaps
from pix2face.models.surface_attributes import REGIONS, check_layers
from pix2face.shards.layers import DEFAULT_LAYERS, IMAGE, LANDMARKS, LAYERS, SCENE_LAYERS, SEEN_REGIONS
from pix2face.shards.triplet import PICTURE, PictureKind, Triplet


@final
class TripletMaker:
    """Turns faces of one model into triplets.

    Args:
        model: The model of the faces.
        gl: Where to render.
        seed: Of everything random in a picture.
        layers: What triplets have, of ``pix2face.shards.layers.LAYER_NAMES``.
        appearance: Of faces that have no photograph.

    Raises:
        UsageError: The model has not what a layer or the appearance needs.
    """

    def __init__(
        self,
        model: MorphableModel,
        gl: GLContext,
        seed: int,
        layers: Sequence[str] = DEFAULT_LAYERS,
        appearance: AppearanceConfig = PRESETS[PLAIN],
    ) -> None:
        check_layers(model, layers)
        check_appearance(model, layers, appearance)
        self._model = model
        self._renderer = Renderer(model, 16, 16, gl)
        self._layers = tuple(layers)
        self._is_drawn = not {IMAGE, *SCENE_LAYERS}.isdisjoint(layers)
        # What is seen of the regions needs the regions.
        self._rendered = (*layers, REGIONS) if SEEN_REGIONS in layers else tuple(layers)
        self._gl, self._seed, self._appearance = gl, seed, appearance
        self._kept_pictures: PictureSource | None = None

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
            rendered = renderer.render(vertices, face.camera, self._rendered)
        if not rendered.mask.any():
            raise SampleRejectedError(f"{face.sample_id}: nothing of the face lies in the picture")
        picture = self._image(view, vertices, rendered, times)
        with times.stage("landmarks, pose"):
            landmarks = self._model.landmarks.get(IBUG68, np.zeros(0, np.int32))
            if LANDMARKS not in self._layers:
                landmarks = landmarks[:0]
            landmarks3d = vertices[landmarks]
            return Triplet(
                sample_id=face.sample_id,
                image=picture.content,
                layers=self._chosen_layers(rendered, picture),
                camera=face.camera,
                identity=face.identity,
                expression=face.expression,
                landmarks2d=face.camera.project(landmarks3d),
                landmarks3d=landmarks3d,
                visible=visible_landmarks(vertices, landmarks, face.camera, rendered),
                attributes={**asdict(head_pose(face.camera)), **face.attributes, **picture.attributes},
            )

    @property
    def _pictures(self) -> PictureSource:
        """Made when the first picture is drawn: photographs need none."""
        if self._kept_pictures is None:
            self._kept_pictures = (
                PlainPictures(self._renderer, self._seed)
                if self._appearance.is_plain
                else ScenePictures(self._model, self._gl, self._seed, self._appearance)
            )
        return self._kept_pictures

    def _chosen_layers(self, rendered: RenderedMaps, picture: DrawnPicture) -> dict[str, ndarray]:
        made = {name: rendered.layer(name) for name in self._layers if name in LAYERS and name not in SCENE_LAYERS}
        return {**made, **{name: picture.layers[name] for name in self._layers if name in picture.layers}}

    def _image(
        self, view: View, vertices: Float32[ndarray, "v 3"], rendered: RenderedMaps, times: StageTimes
    ) -> DrawnPicture:
        """The photograph's own bytes, what a variant shows of it, or a picture of the face; no content without need."""
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
            return DrawnPicture(content, {PICTURE: PictureKind.PHOTOGRAPH})
        if not self._is_drawn:
            return DrawnPicture(None, {})
        return self._pictures.draw(view, vertices, rendered, times)


def check_appearance(model: MorphableModel, layers: Sequence[str], appearance: AppearanceConfig) -> None:
    """Refuses appearances that a model cannot have, and layers that an appearance does not make.

    Raises:
        UsageError: It is so.
    """
    if not appearance.is_plain and model.sha256 != builtin_model().sha256:
        raise UsageError(
            f"--appearance {appearance.preset}: expected the built-in model, whose skins and hair fit no other, found "
            f"{model.name}; give --appearance {PLAIN}"
        )
    wanted = [name for name in layers if name in SCENE_LAYERS]
    if appearance.is_plain and wanted:
        raise UsageError(
            f"--layers {wanted[0]}: expected an appearance in which something stands before faces, found {PLAIN}; "
            "leave the layer out, or draw synthetic photographs with --appearance"
        )
