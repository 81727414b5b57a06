"""Draws a posed face with OpenGL: the maps, exactly, and the picture of a face of a model that has no photographs.

Conventions are those of the oracle, ``pix2face.models.rasterise``: nothing is culled, backs hide but are never face.
One of two rasterisers finds the triangle that each pixel sees; one pass makes everything else from that.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import final

from jaxtyping import Float32, UInt8
from numpy import ndarray

from datagen.appearance.plain_appearance import PlainAppearance
from datagen.opengl.gl_context import GLContext, Rasteriser, choose_rasteriser
from datagen.rendering.compute_rasteriser import ComputeRasteriser
from datagen.rendering.fragment_rasteriser import FragmentRasteriser
from datagen.rendering.gl_mesh import GLMesh
from datagen.rendering.map_drawing import MapDrawer
from datagen.rendering.picture_drawing import PICTURE_OVERSAMPLING, PictureDrawer
from datagen.rendering.screen_projection import project_to_screen
from pix2face.errors import GLUnavailableError, UsageError
from pix2face.geometry.camera import Camera
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.rasterise import RenderedMaps
from pix2face.models.surface_attributes import ATTRIBUTES, REGIONS


@final
class Renderer:
    """Renders faces of one model in one image size; ``with_size`` shares the uploaded model with another size.

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
        self.model = model
        self._scene = _Scene(model, gl, rasteriser or gl.rasteriser)
        self.height, self.width = self._scene.checked_size(height, width)

    def with_size(self, height: int, width: int) -> "Renderer":
        """The same renderer for another size of images; cheap."""
        other = object.__new__(Renderer)
        other.model, other._scene = self.model, self._scene
        other.height, other.width = self._scene.checked_size(height, width)
        return other

    @property
    def rasteriser(self) -> str:
        """The one in use: ``compute`` or ``fragment``."""
        return self._scene.rasteriser_name

    def render(self, vertices: Float32[ndarray, "v 3"], camera: Camera, layers: Sequence[str] = ()) -> RenderedMaps:
        """Renders PNCC, offset, mask, depth and what is asked for of one face.

        Args:
            vertices: This face, mm, model frame, not posed.
            camera: From the model frame to this image.
            layers: Further ones, of ``surface_attributes.EXTRA_LAYERS``; other names are passed over.

        Raises:
            DegenerateGeometryError: The camera flattens space, part of the face is behind a pinhole, or a vertex is
                not finite.
            UsageError: The model has not what a layer needs.
            GLUnavailableError: The driver reports an error.

        Source: Crispell and Bazik 2017, Sec. 3 (PNCC and offset images).
        """
        projection = project_to_screen(camera, vertices, self.height, self.width)
        scene = self._scene
        scene.gl.make_current()
        scene.mesh.load(projection)
        scene.maps.seen_per_pixel = scene.rasteriser.see(projection, self.height, self.width)
        rendered = scene.maps.draw(projection, self.height, self.width, REGIONS in layers)
        size = (self.height, self.width)
        drawn = {
            name: scene.maps.attribute(name, vertices, camera, projection, size)
            for name in layers
            if name in ATTRIBUTES
        }
        scene.check()
        return replace(rendered, extra={**drawn, **rendered.extra}) if drawn else rendered

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
        self._scene.gl.make_current()
        picture = self._scene.pictures.draw(vertices, camera, appearance, background)
        self._scene.check()
        return picture


@final
class _Scene:
    """What lives in the driver for one model."""

    def __init__(self, model: MorphableModel, gl: GLContext, rasteriser: Rasteriser) -> None:
        self.gl, self._context = gl, gl.context
        self.rasteriser_name = choose_rasteriser(rasteriser, gl.version_code)
        gl.make_current()
        self._model = model
        self.mesh = GLMesh(model, gl.context)
        self.maps = MapDrawer(self.mesh, model)
        self.rasteriser = _RASTERISERS[self.rasteriser_name](self.mesh)
        self._pictures: PictureDrawer | None = None

    @property
    def pictures(self) -> PictureDrawer:
        """Made when the first picture is drawn: photographs need none."""
        if self._pictures is None:
            self._pictures = PictureDrawer(self._model, self._context)
        return self._pictures

    def checked_size(self, height: int, width: int) -> tuple[int, int]:
        """The size, if the driver can draw it."""
        limits = self._context.info
        largest = min(
            limits["GL_MAX_RENDERBUFFER_SIZE"], limits["GL_MAX_TEXTURE_SIZE"], *limits["GL_MAX_VIEWPORT_DIMS"]
        )
        largest //= PICTURE_OVERSAMPLING
        if not (0 < height <= largest and 0 < width <= largest):
            raise UsageError(
                f"expected images of 1 to {largest} pixels a side ({self.gl.renderer} draws no larger ones), "
                f"found {height} x {width}"
            )
        return height, width

    def check(self) -> None:
        """Raises GLUnavailableError if OpenGL has an error to report."""
        error = self._context.error
        if error != "GL_NO_ERROR":
            raise GLUnavailableError(f"expected {self.gl.renderer} to draw, found {error}; is its memory full?")


_RASTERISERS: dict[str, type[ComputeRasteriser] | type[FragmentRasteriser]] = {
    "compute": ComputeRasteriser,
    "fragment": FragmentRasteriser,
}
