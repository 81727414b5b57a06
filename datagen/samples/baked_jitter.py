"""Jittered variants of a sample, made at render time.

The maps of a variant are not resampled ones: the face is rendered anew by the camera of the crop, so they are as exact
as any. Only the photograph is resampled. Where a variant is mirrored, its face is the mirrored face.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, final

import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray

from datagen.random_streams import generator_for
from datagen.sampling.expressions import NAMED_EXPRESSIONS, mirrored_strengths, strengths_of, strengths_to_text
from datagen.sampling.views import FOCAL_LENGTH, camera_attributes
from pix2face.errors import DegenerateGeometryError, SampleRejectedError, UsageError
from pix2face.face_files.coefficients import LARGEST_SIDE_PX, Face
from pix2face.geometry.camera import Camera
from pix2face.geometry.crops import Crop, FaceBox, crop_camera
from pix2face.geometry.jitter import JitterParameters, JitterRange, draw_jitter, jitter_crop, jitter_image
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.mirroring import MirroredCoefficients, mirrored_coefficients
from pix2face.models.morphable_model import MorphableModel
from pix2face.shards.sample import JITTER_OF

MOST_VARIANTS = 1000
# What a mirrored photograph and its mirrored face may be apart: a fraction of a pixel.
LARGEST_MIRROR_ERROR_MM = 0.5
# The camera of a mirrored crop sees the mirrored face through this.
MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


@final
@dataclass(frozen=True)
class JitterBake:
    """How many variants of each sample are made, and how."""

    n: int = 0  # variants of each sample, which take its place; 0 makes none and leaves samples as they are
    size_px: int = 256  # side of the variants
    limits: JitterRange = field(default_factory=JitterRange)  # how far they are varied

    def check(self) -> None:
        """Raises a `UsageError` if the numbers make no sense."""
        if not 0 <= self.n <= MOST_VARIANTS:
            raise UsageError(f"--jitter: expected 0 to {MOST_VARIANTS} variants of each sample, found {self.n}")
        if not 0 < self.size_px <= LARGEST_SIDE_PX:
            raise UsageError(f"--jitter-size: expected a side of 1 to {LARGEST_SIDE_PX} pixels, found {self.size_px}")
        if not self.n and self != NO_JITTER:
            raise UsageError("--jitter-size, --jitter-mirror: expected --jitter N with them, found no variants to make")

    def described(self) -> dict[str, Any]:
        """What shards say of it; nothing where no variants are made."""
        return {f"jitter_{name}": value for name, value in asdict(self).items()} if self.n else {}

    def sample_ids(self, sample_id: str) -> tuple[str, ...]:
        """What becomes of one sample: itself, or its variants."""
        return tuple(f"{sample_id}/jitter-{number}" for number in range(self.n)) if self.n else (sample_id,)


NO_JITTER = JitterBake()


@final
@dataclass(frozen=True, eq=False)
class View:
    """What is to be rendered: a face as its source has it, or a jittered variant of it."""

    # Of a variant: its camera, size and id, and the coefficients of the mirrored face where it is mirrored. Its
    # photograph is that of the sample, still to be jittered.
    face: Face
    appearance_id: str  # decides how a drawn picture looks: the id of the sample, the same for all its variants
    crop: Crop | None = None  # of a variant, from the pixels of the sample's picture
    jitter: JitterParameters | None = None  # of a variant: the draw

    def jittered_photograph(self, image: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "s s 3"]:
        """The sample's photograph as the variant shows it: cropped, its colours varied."""
        assert self.crop is not None
        assert self.jitter is not None
        return np.rint(jitter_image(image, self.crop, self.jitter) * 255).astype(np.uint8)

    def jittered_colours(self, image: UInt8[ndarray, "s s 3"]) -> UInt8[ndarray, "s s 3"]:
        """A picture that was drawn for this view, with its colours varied."""
        if self.jitter is None:
            return image
        as_it_is = Crop(np.eye(3), len(image))
        return np.rint(jitter_image(image, as_it_is, self.jitter) * 255).astype(np.uint8)


@final
class ViewMaker:
    """Turns faces of one model into the views that a job renders of them.

    Raises:
        UsageError: Crops have no landmarks to go by, or the model's faces cannot be mirrored.
    """

    def __init__(self, model: MorphableModel, bake: JitterBake, seed: int) -> None:
        if bake.n and IBUG68 not in model.landmarks:
            raise UsageError(f"--jitter: expected a model with the landmarks {IBUG68}, which crops go by; found none")
        self._model = model
        self._bake = bake
        self._seed = seed
        self._mirror = _mirror(model) if bake.n and bake.limits.mirror else None

    def views(self, face: Face) -> list[View]:
        """The views of a face; each from a random stream of its own, so that more of them do not change the first.

        Raises:
            SampleRejectedError: The face's landmarks have no extent in its picture.
        """
        if not self._bake.n:
            return [View(face, face.sample_id)]
        try:
            box = FaceBox.around(face.camera.project(self._landmarks3d(face)))
        except DegenerateGeometryError as error:
            raise SampleRejectedError(f"{face.sample_id}: {error}") from error
        return [self._view(face, box, sample_id) for sample_id in self._bake.sample_ids(face.sample_id)]

    def _view(self, face: Face, box: FaceBox, sample_id: str) -> View:
        jitter = draw_jitter(generator_for(self._seed, sample_id), self._bake.limits)
        crop = jitter_crop(box, jitter, self._bake.size_px)
        camera, identity, expression = crop_camera(face.camera, crop), face.identity, face.expression
        if jitter.mirror:
            assert self._mirror is not None
            camera = Camera(camera.matrix @ MIRROR)
            identity = (identity @ self._mirror.identity).astype(np.float32)
            expression = (expression @ self._mirror.expression).astype(np.float32)
        described: dict[str, str | float] = {
            JITTER_OF: face.sample_id,
            "jitter_scale": jitter.scale,
            "jitter_mirrored": float(jitter.mirror),
        }
        variant = replace(
            face,
            sample_id=sample_id,
            identity=identity,
            expression=expression,
            camera=camera,
            height_px=self._bake.size_px,
            width_px=self._bake.size_px,
            attributes={**_attributes(face.attributes, camera, jitter.mirror), **described},
        )
        return View(variant, face.sample_id, crop, jitter)

    def _landmarks3d(self, face: Face) -> Float32[ndarray, "m 3"]:
        model, vertices = self._model, self._model.landmarks[IBUG68]
        moved = np.tensordot(face.identity, model.identity_basis[:, vertices], axes=1)
        moved = moved + np.tensordot(face.expression, model.expression_basis[:, vertices], axes=1)
        return np.asarray(model.mean[vertices] + moved, dtype=np.float32)


def _attributes(attributes: Mapping[str, str | float], camera: Camera, is_mirrored: bool) -> dict[str, str | float]:
    """Those of a face as the variant has it: its own camera, and left and right exchanged where it is mirrored."""
    changed: dict[str, str | float] = {}
    if FOCAL_LENGTH in attributes:
        changed |= camera_attributes(camera)
    strengths = strengths_of(attributes)
    if is_mirrored and strengths:
        changed[NAMED_EXPRESSIONS] = strengths_to_text(mirrored_strengths(strengths))
    return {**attributes, **changed}


def _mirror(model: MorphableModel) -> MirroredCoefficients:
    mirror = mirrored_coefficients(model)
    if not mirror.largest_error_mm <= LARGEST_MIRROR_ERROR_MM:
        raise UsageError(
            f"--jitter-mirror: the coefficients of {model.name} cannot say the mirror image of a face: one component "
            f"would be {mirror.largest_error_mm:.2f} mm off (at most {LARGEST_MIRROR_ERROR_MM} mm are allowed)"
        )
    return mirror
