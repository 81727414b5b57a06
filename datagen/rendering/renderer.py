"""Draws a posed face with OpenGL: the maps, exactly, and the picture of a face of a model that has no photographs.

Conventions are those of the oracle, ``pix2face.models.rasterise``: nothing is culled, backs hide but are never face.
One of two rasterisers finds the triangle that each pixel sees; one pass makes everything else from that.
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
from datagen.opengl.gl_context import GLContext, choose_rasteriser
from datagen.rendering.compute_rasteriser import ComputeRasteriser
from datagen.rendering.fragment_rasteriser import FragmentRasteriser
from datagen.rendering.gl_mesh import GLMesh
from datagen.rendering.map_drawing import MapDrawer
from datagen.rendering.picture_drawing import PICTURE_OVERSAMPLING, PictureDrawer
from datagen.rendering.screen_projection import project_to_screen
from pix2face.errors import UsageError
from pix2face.geometry.camera import Camera
from pix2face.geometry.landmarks import LANDMARK_TOLERANCE_MM
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.surface_attributes import ATTRIBUTES, REGIONS


@final
class Renderer:
    """Renders faces of one model in one size of images; ``with_size`` shares the uploaded model with another size.

    Args:
        model: Mean, triangles and regions.
        height: Rows of the images.
        width: Columns of the images.
        gl: Where to draw. It is made current whenever something is drawn.
        rasteriser: ``compute``, ``fragment``, or None for the choice that ``gl`` carries.

    Raises:
        UsageError: The size is not positive, or larger than the driver draws.
        GLUnavailableError: The rasteriser that was asked for needs a newer OpenGL.
    """

    def __init__(
        self, model: MorphableModel, height: int, width: int, gl: GLContext, rasteriser: Rasteriser | None = None
    ) -> None:
        self.rasteriser = choose_rasteriser(rasteriser or gl.rasteriser, gl.version_code)  # the one in use
        gl.make_current()
        self.model, self._gl = model, gl
        self._mesh = GLMesh(model, gl.context)
        self._maps = MapDrawer(self._mesh, model)
        self._triangles = _RASTERISERS[self.rasteriser](self._mesh)
        self._pictures = cache(lambda: PictureDrawer(model, gl.context))  # photographs need none
        self._set_size(height, width)

    def with_size(self, height: int, width: int) -> "Renderer":
        """Returns this renderer for images of another size; this is cheap."""
        other = copy(self)
        other._set_size(height, width)
        return other

    def render(
        self, vertices: Float32[ndarray, "v 3"], camera: Camera, layers: Sequence[str] = ()
    ) -> dict[str, ndarray]:
        """Renders PNCC, offset, mask, depth and what is asked for of one face.

        Args:
            vertices: This face, mm, model frame, not posed.
            camera: From the model frame to this image.
            layers: Further ones, of ``surface_attributes.EXTRA_LAYERS``; other names are passed over.

        Returns:
            As ``pix2face.models.rasterise.render_maps``.

        Raises:
            DegenerateGeometryError: The camera flattens space, part of the face is behind a pinhole, or a vertex is
                not finite.
            UsageError: The model has not what a layer needs.
            GLUnavailableError: The driver reports an error.

        Source: Crispell and Bazik 2017, Sec. 3 (PNCC and offset images).
        """
        size = self.height, self.width
        projection = project_to_screen(camera, vertices, *size)
        self._gl.make_current()
        self._mesh.load(projection)
        self._maps.seen_per_pixel = self._triangles.see(projection, *size)
        rendered = self._maps.draw(projection, *size, REGIONS in layers)
        for name in layers:
            if name in ATTRIBUTES:
                rendered[name] = self._maps.attribute(name, vertices, camera, projection, size)
        self._gl.check()
        return rendered

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
        """
        if background.shape[:2] != (self.height, self.width):
            raise UsageError(
                f"expected a background of {self.height} x {self.width} pixels, found {background.shape[:2]}"
            )
        self._gl.make_current()
        picture = self._pictures().draw(vertices, camera, appearance, background)
        self._gl.check()
        return picture

    def _set_size(self, height: int, width: int) -> None:
        limits = self._gl.context.info
        largest = min(
            limits["GL_MAX_RENDERBUFFER_SIZE"], limits["GL_MAX_TEXTURE_SIZE"], *limits["GL_MAX_VIEWPORT_DIMS"]
        )
        largest //= PICTURE_OVERSAMPLING
        if not (0 < height <= largest and 0 < width <= largest):
            raise UsageError(
                f"expected images of 1 to {largest} pixels a side ({self._gl.renderer} draws no larger ones), "
                f"found {height} x {width}"
            )
        self.height, self.width = height, width


_RASTERISERS: dict[str, type[ComputeRasteriser] | type[FragmentRasteriser]] = {
    "compute": ComputeRasteriser,
    "fragment": FragmentRasteriser,
}


def visible_landmarks(
    vertices: Float[ndarray, "v 3"],
    landmarks: Int[ndarray, " m"],
    camera: Camera,
    surface_depth: Float32[ndarray, "h w"],
) -> Bool[ndarray, " m"]:
    """Which landmarks lie in the image and on its nearest surface.

    Args:
        vertices: This face, mm, model frame.
        landmarks: Vertex of each landmark.
        camera: From the model frame to this image.
        surface_depth: As rendered through this camera, mm. Hair, neck and the inside of the head hide as well.
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
