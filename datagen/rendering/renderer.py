"""Draws a posed face: the maps, exactly, and the picture of a face of a model that has no photographs.

Conventions are those of the oracle, ``pix2face.models.rasterise``: nothing is culled, backs hide but are never face.
Maps are drawn on the processor, or on a GPU by OpenGL's compute shaders. Pictures always need OpenGL.
"""

from collections.abc import Sequence
from copy import copy
from functools import cache
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8
from numpy import ndarray

from datagen.appearance.plain_appearance import PlainAppearance
from datagen.opengl import Rasteriser
from datagen.opengl.gl_context import REMEDY, GLContext
from datagen.opengl.rasteriser_choice import choose_rasteriser
from datagen.rendering.map_drawing import MapDrawer
from datagen.rendering.picture_drawing import PICTURE_OVERSAMPLING, PictureDrawer
from datagen.rendering.processor.processor_maps import ProcessorMaps
from pix2face.errors import GLUnavailableError, UsageError
from pix2face.face_files.coefficients import LARGEST_SIDE_PX
from pix2face.geometry.camera import Camera
from pix2face.geometry.landmarks import LANDMARK_TOLERANCE_MM
from pix2face.models.morphable_model import MorphableModel


@final
class Renderer:
    """Renders faces of one model in one size of images; ``with_size`` shares the loaded model with another size.

    Without ``gl``, it renders maps alone, on the processor. OpenGL is made current whenever it draws. The rasteriser is
    ``processor``, ``compute``, or None for the choice that ``gl`` carries.

    Raises:
        UsageError: The size is not positive, or larger than can be drawn.
        GLUnavailableError: The rasteriser that was asked for needs OpenGL, or a newer one.
    """

    def __init__(
        self,
        model: MorphableModel,
        height: int,
        width: int,
        gl: GLContext | None = None,
        rasteriser: Rasteriser | None = None,
    ) -> None:
        wanted: Rasteriser = rasteriser or (gl.rasteriser if gl else "auto")
        version, is_software = (gl.version_code, gl.is_software) if gl else (0, False)
        self.rasteriser = choose_rasteriser(wanted, version, is_software=is_software)  # the one in use
        self.model, self._gl = model, gl
        self._maps: MapDrawer | ProcessorMaps
        if gl is not None and self.rasteriser == "compute":
            self._maps = MapDrawer(model, gl)
        else:
            self._maps = ProcessorMaps(model)
        self._pictures = cache(lambda context: PictureDrawer(model, context))  # photographs need none
        self._set_size(height, width)

    def with_size(self, height: int, width: int) -> "Renderer":
        """Returns this renderer for images of another size; this is cheap."""
        other = copy(self)
        other._set_size(height, width)
        return other

    def render(
        self,
        vertices: Float32[ndarray, "v 3"],
        camera: Camera,
        layers: Sequence[str] = (),
        *,
        in_steps: bool = False,
    ) -> dict[str, ndarray]:
        """Renders PNCC, offset, mask, depth and what is asked for of one face, as ``rasterise.render_maps`` does.

        With ``in_steps``, PNCC and offset may be in steps of 1/128 mm (int16), as shards store them.

        Raises:
            DegenerateGeometryError: The camera flattens space, part of the face is behind a pinhole, or a vertex is
                not finite.
            UsageError: The model has not what a layer needs.
            GLUnavailableError: The driver reports an error.

        Source: Crispell and Bazik 2017, Sec. 3 (PNCC and offset images).
        """
        return self._maps.render(vertices, camera, (self.height, self.width), layers, in_steps=in_steps)

    def render_image(
        self,
        vertices: Float32[ndarray, "v 3"],
        camera: Camera,
        appearance: PlainAppearance,
        background: UInt8[ndarray, "h w 3"],
    ) -> UInt8[ndarray, "h w 3"]:
        """Renders the lit, painted head over a background (sRGB), edges smooth.

        Raises:
            DegenerateGeometryError: As ``render``.
            UsageError: The background has another size than the renderer.
            GLUnavailableError: There is no OpenGL.
        """
        if background.shape[:2] != (self.height, self.width):
            raise UsageError(
                f"expected a background of {self.height} x {self.width} pixels, found {background.shape[:2]}"
            )
        if self._gl is None:
            raise GLUnavailableError(f"expected OpenGL, which draws pictures, found a renderer without; {REMEDY}")
        self._gl.make_current()
        picture = self._pictures(self._gl.context).draw(vertices, camera, appearance, background)
        self._gl.check()
        return picture

    def _set_size(self, height: int, width: int) -> None:
        largest, who = LARGEST_SIDE_PX, "the processor"
        if self._gl is not None:
            limits = self._gl.context.info
            largest = min(
                limits["GL_MAX_RENDERBUFFER_SIZE"], limits["GL_MAX_TEXTURE_SIZE"], *limits["GL_MAX_VIEWPORT_DIMS"]
            )
            largest, who = largest // PICTURE_OVERSAMPLING, self._gl.renderer
        if not (0 < height <= largest and 0 < width <= largest):
            raise UsageError(
                f"expected images of 1 to {largest} pixels a side ({who} draws no larger ones), "
                f"found {height} x {width}"
            )
        self.height, self.width = height, width


def visible_landmarks(
    vertices: Float[ndarray, "v 3"],
    landmarks: Int[ndarray, " m"],
    camera: Camera,
    surface_depth: Float32[ndarray, "h w"],
) -> Bool[ndarray, " m"]:
    """Which landmarks (vertices of a face in mm, model frame) lie in the image and on its nearest surface.

    The depth of the surface (mm) was rendered through this camera: hair, neck and the inside of the head hide as well.
    """
    points = vertices[landmarks]
    height, width = surface_depth.shape
    column, row = np.floor(camera.project(points)).astype(np.int64).T
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    surface = surface_depth[np.where(inside, row, 0), np.where(inside, column, 0)]
    # The depth is taken up to 0.7 px beside the landmark, where a slanting cheek is some millimetres deeper: the
    # tolerance also covers this. At the silhouette, the centre of the landmark's own pixel may be background (inf): the
    # landmark counts as seen.
    return np.asarray(inside & (camera.depth(points) < surface + LANDMARK_TOLERANCE_MM))
