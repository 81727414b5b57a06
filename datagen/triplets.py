"""One face to one triplet: geometry, maps, picture, landmarks."""

from dataclasses import asdict
from typing import final

import numpy as np
from numpy import ndarray

from datagen.appearance.background import draw_background
from datagen.appearance.plain import develop, draw_plain_appearance
from datagen.gl_context import GLContext
from datagen.random_streams import generator_for
from datagen.renderer import Renderer
from datagen.visibility import visible_landmarks
from pix2face.camera import head_pose
from pix2face.coefficients import Face
from pix2face.errors import DegenerateGeometryError, InputFileError, SampleRejectedError, UsageError
from pix2face.face_maps import FIXED_POINT_LIMIT_MM
from pix2face.images import encode_image, read_bytes
from pix2face.landmarks import IBUG68
from pix2face.layers import LAYERS
from pix2face.morphable_model import MorphableModel
from pix2face.shards import Triplet


@final
class TripletMaker:
    """Turns faces of one model into triplets.

    Args:
        model: The model of the faces.
        gl: Where to render.
        seed: Of everything random in a picture.
    """

    def __init__(self, model: MorphableModel, gl: GLContext, seed: int) -> None:
        self._model = model
        self._renderer = Renderer(model, 16, 16, gl)
        self._seed = seed

    def make(self, face: Face) -> Triplet:
        """Renders one face.

        Raises:
            SampleRejectedError: Nothing of the face is in the picture, it is partly behind the camera, its
                photograph cannot be read, the picture is larger than the driver can draw, or a value is beyond what
                a shard can hold.
        """
        try:
            triplet = self._make(face)
            _check_range(triplet)
            return triplet
        except (DegenerateGeometryError, InputFileError, UsageError) as error:
            raise SampleRejectedError(f"{face.sample_id}: {error}") from error

    def _make(self, face: Face) -> Triplet:
        model = self._model
        vertices = model.vertices(face.identity[None], face.expression[None])[0]
        renderer = self._renderer.with_size(face.height_px, face.width_px)
        rendered = renderer.render(vertices, face.camera)
        if not rendered.mask.any():
            raise SampleRejectedError(f"{face.sample_id}: nothing of the face lies in the picture")
        landmarks = model.landmarks.get(IBUG68, np.zeros(0, np.int32))
        landmarks3d = vertices[landmarks]
        image, drawn = self._image(face, renderer, vertices)
        pose = head_pose(face.camera)
        return Triplet(
            sample_id=face.sample_id,
            image=image,
            layers={
                "pncc": rendered.pncc,
                "offset": rendered.offset,
                "mask": rendered.mask,
                "depth": rendered.depth,
            },
            camera=face.camera,
            identity=face.identity,
            expression=face.expression,
            landmarks2d=face.camera.project(landmarks3d),
            landmarks3d=landmarks3d,
            visible=visible_landmarks(vertices, landmarks, face.camera, rendered),
            attributes={**asdict(pose), **face.attributes, **drawn},
        )

    def _image(self, face: Face, renderer: Renderer, vertices: ndarray) -> tuple[bytes, dict[str, str | float]]:
        """The photograph's own bytes, or a picture of the face."""
        if face.image_path is not None:
            return read_bytes(face.image_path), {"picture": "photograph"}
        rng = generator_for(self._seed, face.sample_id)
        appearance = draw_plain_appearance(rng)
        background = draw_background(rng, face.height_px, face.width_px)
        picture = renderer.render_image(vertices, face.camera, appearance, background)
        return encode_image(develop(picture, appearance)), {"picture": "rendered"}


def _check_range(triplet: Triplet) -> None:
    """Refuses what the format cannot hold; found only on writing, it would cost the whole shard.

    Raises:
        InputFileError: A value is not finite or too large.
    """
    layers, largest = triplet.layers, float(np.finfo(np.float32).max)
    for name, values, limit in (
        ("map values in mm", np.stack([layers["pncc"], layers["offset"]]), FIXED_POINT_LIMIT_MM),
        ("depths in mm", layers["depth"], LAYERS["depth"].limit),
        ("landmarks in pixels", triplet.landmarks2d, largest),
        ("landmarks in mm", triplet.landmarks3d, largest),
    ):
        found = float(np.abs(values).max(initial=0))
        if not found <= limit:  # also catches NaN
            raise InputFileError(f"expected {name} within ±{limit:g}, found {found:g}: are the coefficients sound?")
