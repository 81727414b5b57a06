"""From faces to samples: geometry, layers, landmarks, picture."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from datagen.appearance.appearance_config import PLAIN, PRESETS, AppearanceConfig
from datagen.opengl.gl_context import REMEDY, GLContext
from datagen.rendering.renderer import Renderer, visible_landmarks
from datagen.samples.baked_jitter import View
from datagen.samples.drawn_pictures import PlainPictures, ScenePictures
from datagen.samples.stage_times import StageTimes
from pix2face.errors import (
    DegenerateGeometryError,
    GLUnavailableError,
    InputFileError,
    SampleRejectedError,
    UsageError,
)
from pix2face.face_files.coefficients import Face
from pix2face.files.images import check_decodes, decode_image, encode_photograph, read_bytes, upright_bytes
from pix2face.geometry.camera import head_pose
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.morphable_model import MorphableModel, builtin_model
from pix2face.models.rasterise import SURFACE_DEPTH
from pix2face.models.surface_attributes import REGIONS, check_layers
from pix2face.shards.layers import DEFAULT_LAYERS, IMAGE, LANDMARKS, LAYERS, SCENE_LAYERS, SEEN_REGIONS
from pix2face.shards.sample import MASK, PICTURE, PictureKind, Sample


@final
class SampleMaker:
    """Turns faces of one model into samples.

    OpenGL is needed for faces without photographs, if pictures are wanted; appearance and seed are those of what it
    draws.

    Raises:
        UsageError: The model has not what a layer or the appearance needs.
    """

    def __init__(
        self,
        model: MorphableModel,
        gl: GLContext | None,
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

    def make(self, face: Face) -> Sample:
        """Renders one face as its source has it.

        Raises:
            SampleRejectedError: Nothing of the face is in the picture, it is partly behind the camera, its
                photograph cannot be read, or the picture is larger than the driver can draw.
        """
        (made,) = self.make_all([View(face, face.sample_id)], StageTimes())
        if isinstance(made, SampleRejectedError):
            raise made
        return made

    def make_all(
        self, views: Sequence[View], times: StageTimes, *, in_steps: bool = False
    ) -> Iterator[Sample | SampleRejectedError]:
        """Renders views whose geometry is computed together: all their vertices are in memory at the same time.

        With ``in_steps``, layers may be in steps, as shards store them.

        Yields:
            For each view its sample, or why there is none, as in ``make``.
        """
        if not views:
            return
        with times.stage("geometry"):
            batch = self._geometry([view.face for view in views])
        for view, vertices in zip(views, batch, strict=True):
            try:
                yield self._make(view, vertices, times, in_steps=in_steps)
            except SampleRejectedError as error:
                yield error
            except (DegenerateGeometryError, InputFileError, UsageError) as error:
                yield SampleRejectedError(f"{view.face.sample_id}: {error}")

    def _geometry(self, faces: Sequence[Face]) -> list[Float32[ndarray, "v 3"]]:
        """The vertices of each face. Variants of a face, and its photographs from several sides, share them."""
        coefficients = [(face.identity.tobytes(), face.expression.tobytes()) for face in faces]
        different = dict(zip(coefficients, faces, strict=True))
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is rejected when it is drawn
            vertices = self._model.vertices(
                np.stack([face.identity for face in different.values()]),
                np.stack([face.expression for face in different.values()]),
            )
        of_coefficients = dict(zip(different, vertices, strict=True))
        return [of_coefficients[own] for own in coefficients]

    def _make(self, view: View, vertices: Float32[ndarray, "v 3"], times: StageTimes, *, in_steps: bool) -> Sample:
        face = view.face
        with times.stage("rasterise, read back"):
            renderer = self._renderer.with_size(face.height_px, face.width_px)
            rendered = renderer.render(vertices, face.camera, self._rendered, in_steps=in_steps)
        if not rendered[MASK].any():
            raise SampleRejectedError(f"{face.sample_id}: nothing of the face lies in the picture")
        with times.stage("landmarks, pose"):
            landmarks = self._model.landmarks.get(IBUG68, np.zeros(0, np.int32))
            if LANDMARKS not in self._layers:
                landmarks = landmarks[:0]
            landmarks3d = vertices[landmarks]
            rendered_layers = (MASK, *(name for name in self._rendered if name in LAYERS and name not in SCENE_LAYERS))
            sample = Sample(
                sample_id=face.sample_id,
                image_bytes=None,
                layers={name: rendered[name] for name in rendered_layers},
                camera=face.camera,
                identity=face.identity,
                expression=face.expression,
                landmarks2d=face.camera.project(landmarks3d),
                landmarks3d=landmarks3d,
                visible=visible_landmarks(vertices, landmarks, face.camera, rendered[SURFACE_DEPTH]),
                attributes={**vars(head_pose(face.camera)), **face.attributes},
            )
        sample = self._with_picture(sample, view, vertices, times)
        return replace(sample, layers={name: sample.layers[name] for name in self._layers if name in sample.layers})

    @cached_property
    def _pictures(self) -> PlainPictures | ScenePictures:
        """Made when the first picture is drawn: photographs need none."""
        if self._appearance.is_plain:
            return PlainPictures(self._renderer, self._seed)
        if self._gl is None:
            raise GLUnavailableError(f"expected OpenGL, which draws pictures, found a job without; {REMEDY}")
        return ScenePictures(self._model, self._gl, self._seed, self._appearance)

    def _with_picture(self, sample: Sample, view: View, vertices: Float32[ndarray, "v 3"], times: StageTimes) -> Sample:
        """Adds the photograph (its own bytes if they are upright), a crop of it for a variant, or a drawn picture."""
        path = view.face.image_path
        if path is not None:
            # A damaged photograph rejects its sample even where pictures are not kept: which samples a set has does not
            # depend on its layers.
            with times.stage("read, check photograph"):
                content = upright_bytes(read_bytes(path), str(path))
                if view.crop is None:
                    check_decodes(content, str(path))
                else:
                    content = encode_photograph(view.jittered_photograph(decode_image(content, str(path))))
            return replace(
                sample, image_bytes=content, attributes={**sample.attributes, PICTURE: PictureKind.PHOTOGRAPH}
            )
        return self._pictures.draw(sample, view, vertices, times) if self._is_drawn else sample


def check_appearance(model: MorphableModel, layers: Sequence[str], appearance: AppearanceConfig) -> None:
    """Raises a `UsageError` if a model cannot have an appearance, or an appearance does not make a layer."""
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
