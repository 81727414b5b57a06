"""Colours for a fitted mesh, taken from its photograph: per vertex, or as a texture."""

from dataclasses import dataclass
from functools import lru_cache
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int, Int32, UInt8
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pix2face.errors import UsageError
from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.camera import Camera
from pix2face.geometry.crops import Crop, FaceBox, crop_camera, crop_image, square_crop
from pix2face.geometry.landmarks import IBUG68
from pix2face.geometry.maps import nearest_inside
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.rasterise import rasterise
from pix2face.models.surface_attributes import facing

# The smallest texture is taken that has this many texels for the face (three times as many as a crop has pixels), and
# as many as the photograph has pixels in the box of its landmarks.
FACE_TEXELS = 180_000
TEXTURE_SIZES_PX = (512, 1024, 2048, 4096)
# The face is cut out of the photograph at this size, or at half that of a larger texture: finer than any texel of it.
PICTURE_PX = 1024
DEPTH_PX = 512
# A point is seen unless something is nearer by more than this, which allows for half a millimetre a pixel and slopes.
DEPTH_TOLERANCE_MM = 2.0
# Beside a step of the surface, or its outline, a fit that is off by a pixel would take the colour of what is beyond.
STEP_MM, STEP_REACH_PX = 10.0, 2
# A surface counts fully from this cosine to the viewer up, and not at all below the other: there a pixel is smeared.
FULL_COSINE, LEAST_COSINE = 0.5, 0.15
NO_COLOUR = 128.0
# Skin has its colour from around the nose: what is farther away may be hair. Towards scalp and neck the photograph's
# colours fade out over the last millimetres of the face. An ear much darker than the skin is covered by hair.
MIDDLE_MM, BORDER_FADE_MM = 60.0, 25.0
HAIR_BRIGHTNESS, EAR_BRIGHTNESS = 0.4, 0.6
EARS = "ears"
NOSE_TIP = 30  # of the 68 landmarks
# What is not seen takes the mean colour of so many seen points (of at most so many), fading over this distance; three
# times as far nothing of it is left.
NEIGHBOURS, MOST_NEIGHBOURS, FADE_MM, REACH_FADES = 6, 40_000, 12.0, 3
# Around each island of the texture, so that a viewer's filter does not blend in what lies beyond.
PADDING_PX = 8


@final
@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points of a mesh.

    Attributes:
        corners: For each point the vertices of its triangle.
        weights: Barycentric weights.
    """

    corners: Int32[ndarray, "n 3"]
    weights: Float64[ndarray, "n 3"]

    @classmethod
    def vertices(cls, n: int) -> "SurfacePoints":
        """The vertices 0 to n - 1 themselves."""
        return cls(np.repeat(np.arange(n, dtype=np.int32)[:, None], 3, axis=1), np.tile([1.0, 0.0, 0.0], (n, 1)))

    def interpolate(self, attribute: Float[ndarray, "v ..."]) -> Float64[ndarray, "n ..."]:
        """Interpolates a quantity that is given per vertex at the points."""
        # Column by column, since NumPy gathers and adds long rows fastest.
        columns = np.ascontiguousarray(attribute.reshape(len(attribute), -1).T)
        total = sum(
            columns.take(own, axis=1) * weight for own, weight in zip(self.corners.T, self.weights.T, strict=True)
        )
        return np.asarray(total, dtype=np.float64).T.reshape(-1, *attribute.shape[1:])

    def some(self, chosen: Int[ndarray, " m"]) -> "SurfacePoints":
        """Some of the points."""
        return SurfacePoints(self.corners[chosen], self.weights[chosen])


@final
class PhotographColours:
    """The colours of a fitted face, as far as they can be found in its photograph.

    A visible point of the face has its colour in the photograph. A hidden point has the colour of its mirror point, if
    the model is symmetric and the mirror point is visible. The rest of the face has the colour of the visible parts
    around it, which fades to the median colour of the middle of the face. Everything that is not face (scalp, neck, and
    ears that hair covers) has this median colour. In between, colours are blended, depending on how much the surface
    faces the viewer, and towards scalp and neck. The fit is in pixels of the image.

    Attributes:
        skin: The median colour of the middle of the face, RGB; grey if no part of the face is visible.

    Raises:
        DegenerateGeometryError: The face has no extent in the image, or is not in front of the camera.
    """

    def __init__(
        self, image: UInt8[ndarray, "h w 3"], fit: FaceFit, model: MorphableModel, picture_px: int = PICTURE_PX
    ) -> None:
        box = FaceBox.around(fit.camera.project(fit.vertices[model.is_face_vertex].astype(np.float64)))
        self._model = model
        self._vertices = fit.vertices.astype(np.float64)
        self._to_picture = square_crop(box, 1.1, picture_px)
        self._picture = crop_image(image, self._to_picture).astype(np.float32)
        self._inside = crop_image(np.full(image.shape[:2], 255, np.uint8), self._to_picture)
        self._camera = fit.camera
        self._depth_camera, self._depths = _depths(fit, model, square_crop(box, 1.1, DEPTH_PX))
        self._cosines = facing(self._vertices, model.triangles, fit.camera)
        self._share = _share_of_photograph(model)
        self._is_ear = np.isin(np.arange(len(model.mean)), model.vertices_of(EARS))
        from_nose = np.linalg.norm(model.mean - model.mean[model.landmarks[IBUG68][NOSE_TIP]], axis=1)
        self.skin = self._skin(from_nose < MIDDLE_MM)

    def at(self, points: SurfacePoints) -> UInt8[ndarray, "n 3"]:
        """Colours (RGB) of points of the mesh."""
        colour, weight = self._seen(points)
        weight *= self._uncovered(points, colour)
        below = self._around(points, colour, weight > 0.5)
        if self._model.symmetry is not None:
            unsure = np.flatnonzero(weight != 1)  # rounding makes some a little larger
            mirrored = SurfacePoints(self._model.symmetry[points.corners[unsure]], points.weights[unsure])
            colour_there, weight_there = self._seen(mirrored)
            weight_there *= self._uncovered(mirrored, colour_there)
            below[unsure] = _blend(colour_there, weight_there, below[unsure])
        return np.clip(np.rint(_blend(colour, weight, below)), 0, 255).astype(np.uint8)

    def _skin(self, is_middle: Bool[ndarray, " v"]) -> Float64[ndarray, "3"]:
        """The median colour of the vertices that are seen around the nose, else of all that are seen."""
        colour, weight = self._seen(SurfacePoints.vertices(len(is_middle)))
        seen = weight > 0.5
        chosen = seen & is_middle if (seen & is_middle).any() else seen
        return np.median(colour[chosen], axis=0).astype(np.float64) if chosen.any() else np.full(3, NO_COLOUR)

    def _uncovered(self, points: SurfacePoints, colour: Float32[ndarray, "n 3"]) -> Float64[ndarray, " n"]:
        """0 for points of the ears that are as dark as hair beside this skin, 1 for those that are not, and between."""
        brightness = colour.mean(axis=1) / max(float(self.skin.mean()), 1.0)
        bright = np.clip((brightness - HAIR_BRIGHTNESS) / (EAR_BRIGHTNESS - HAIR_BRIGHTNESS), 0, 1)
        return np.where(self._is_ear[points.corners].any(axis=1), bright, 1.0).astype(np.float64)

    def _around(
        self, points: SurfacePoints, colour: Float32[ndarray, "n 3"], sure: Bool[ndarray, " n"]
    ) -> Float64[ndarray, "n 3"]:
        """What is seen near each point, fading to the colour of the skin: folds and lids leave no lines."""
        below = np.tile(self.skin, (len(sure), 1))
        if not sure.any():
            return below
        unsure = np.flatnonzero(~sure & ~self._is_ear[points.corners].any(axis=1))
        unsure = unsure[points.some(unsure).interpolate(self._share) == 1]
        known = np.flatnonzero(sure)[:: max(1, int(sure.sum()) // MOST_NEIGHBOURS)]
        neighbours = list(range(1, min(NEIGHBOURS, len(known)) + 1))
        known_places, places = (points.some(own).interpolate(self._model.mean) for own in (known, unsure))
        # Among the many points of a texture, a tree that is built in a hurry answers twice as fast.
        tree = cKDTree(known_places, compact_nodes=len(known) < MOST_NEIGHBOURS)
        distance, nearest = tree.query(places, k=neighbours, distance_upper_bound=REACH_FADES * FADE_MM)
        near = np.isfinite(distance).all(axis=1)
        share = np.exp(-((distance[near].mean(axis=1, keepdims=True) / FADE_MM) ** 2))
        around = colour[known[nearest[near]]].mean(axis=1)
        below[unsure[near]] = share * around + (1 - share) * self.skin
        return below

    def _seen(self, points: SurfacePoints) -> tuple[Float32[ndarray, "n 3"], Float64[ndarray, " n"]]:
        """The photograph's colour where each point is projected, and how much it is worth, 0 to 1."""
        cosines = points.interpolate(self._cosines)
        weight = np.clip((cosines - LEAST_COSINE) / (FULL_COSINE - LEAST_COSINE), 0, 1)
        weight *= points.interpolate(self._share)
        colour = np.zeros((len(weight), 3), dtype=np.float32)
        maybe = np.flatnonzero(weight)  # the rest is not looked up in the photograph
        places = points.some(maybe).interpolate(self._vertices)
        own_depth, pixel = self._depth_camera.depth(places), self._depth_camera.project(places)
        here, nearest, farthest = _sample(self._depths, pixel, cv2.INTER_NEAREST).T
        is_seen = own_depth <= here + DEPTH_TOLERANCE_MM
        is_seen &= (nearest >= own_depth - STEP_MM) & (farthest <= own_depth + STEP_MM)
        pixels = self._to_picture.to_crop(self._camera.project(places))
        is_seen &= _sample(self._inside, pixels, cv2.INTER_LINEAR) >= 255
        weight[maybe] *= is_seen
        colour[maybe] = _sample(self._picture, pixels, cv2.INTER_LINEAR)
        return colour, weight


def vertex_colours(image: UInt8[ndarray, "h w 3"], fit: FaceFit, model: MorphableModel) -> UInt8[ndarray, "v 3"]:
    """The colour (RGB) of each vertex of a fitted face, from its photograph.

    Raises:
        DegenerateGeometryError: As ``PhotographColours``.
    """
    return PhotographColours(image, fit, model).at(SurfacePoints.vertices(len(model.mean)))


def face_texture(
    image: UInt8[ndarray, "h w 3"], fit: FaceFit, model: MorphableModel, size_px: int | None = None
) -> UInt8[ndarray, "s s 3"]:
    """A texture in the model's own texture coordinates (u right, v up), from a photograph.

    Without a size, its side is fine enough for the photograph and the face, whose part of the texture depends on the
    model.

    Raises:
        DegenerateGeometryError: As ``PhotographColours``.
        UsageError: The model has no texture coordinates.
    """
    if model.uv is None or model.uv_triangles is None:
        raise UsageError(
            f"expected texture coordinates in the model {model.name!r}, found none; take vertex colours instead"
        )
    if size_px is None:
        n_texels = max(FACE_TEXELS, np.prod(np.ptp(fit.landmarks2d, axis=0)))
        size_px = _fine_enough(model.uv, model.uv_triangles[model.is_face_triangle], n_texels)
    layout = _texture_layout(model, size_px)
    colours = PhotographColours(image, fit, model, max(PICTURE_PX, size_px // 2))
    texture = np.tile(np.rint(colours.skin).astype(np.uint8), (layout.size_px**2, 1))
    texture[layout.drawn] = colours.at(layout.points)
    texture[layout.around] = texture[layout.nearest]
    return texture.reshape(layout.size_px, layout.size_px, 3)


@final
@dataclass(frozen=True, eq=False)
class _TextureLayout:
    """Where the surface of a model is in a texture. Texels are numbers of the flat picture."""

    size_px: int
    drawn: Int[ndarray, " n"]  # texels of the face
    points: SurfacePoints  # of the surface, one for each of them
    around: Int[ndarray, " a"]  # texels within some pixels of them
    nearest: Int[ndarray, " a"]  # for each, the nearest texel of the face


@lru_cache(maxsize=2)
def _texture_layout(model: MorphableModel, size_px: int) -> _TextureLayout:
    """The layout of a model's face, which all textures of a size share."""
    assert model.uv is not None
    assert model.uv_triangles is not None
    is_face = model.is_face_triangle
    triangles = model.uv_triangles[is_face]
    places = np.column_stack([model.uv[:, 0] * size_px, (1 - model.uv[:, 1]) * size_px]).astype(np.float64)
    # The part of the texture where the face is: of the built-in model's a seventh.
    margin, of_face = PADDING_PX + 1, places[np.unique(triangles)]
    left, top = np.clip(np.floor(of_face.min(axis=0, initial=size_px)).astype(int) - margin, 0, size_px)
    right, bottom = np.clip(np.ceil(of_face.max(axis=0, initial=0)).astype(int) + margin, 0, size_px)
    texel = size_px * np.arange(top, bottom)[:, None] + np.arange(left, right)
    in_part = np.column_stack([places - [left, top], np.zeros(len(places))])
    fragments = rasterise(np.eye(4), in_part, triangles, *texel.shape)
    is_drawn = fragments.triangle >= 0
    corners = model.triangles[is_face][fragments.triangle[is_drawn]]
    points = SurfacePoints(corners, fragments.barycentric[is_drawn])
    if not len(corners):
        return _TextureLayout(size_px, texel[is_drawn], points, texel[is_drawn], texel[is_drawn])
    distance, nearest = nearest_inside(is_drawn)
    is_around = (distance > 0) & (distance <= PADDING_PX)
    return _TextureLayout(size_px, texel[is_drawn], points, texel[is_around], texel.reshape(-1)[nearest[is_around]])


@lru_cache(maxsize=2)
def _share_of_photograph(model: MorphableModel) -> Float64[ndarray, " v"]:
    """1 for vertices of the face, fading to 0 towards scalp and neck: the largest part of the mesh that is not face."""
    share = model.is_face_vertex.astype(np.float64)
    others = model.triangles[~model.is_face_triangle]
    if len(others):
        edges = others[:, [0, 1, 1, 2]].reshape(-1, 2).T
        graph = coo_array((np.ones(edges.shape[1]), edges), shape=(len(share), len(share)))
        part_of_vertex = connected_components(graph, directed=False)[1]
        head = part_of_vertex == np.bincount(part_of_vertex[np.unique(others)]).argmax()
        distance = cKDTree(model.mean[head]).query(model.mean, distance_upper_bound=BORDER_FADE_MM)[0]
        share *= np.clip(distance / BORDER_FADE_MM, 0, 1)
    return share


def _fine_enough(uv: Float32[ndarray, "u 2"], triangles: Int[ndarray, "t 3"], n_texels: float) -> int:
    (x0, y0), (x1, y1), (x2, y2) = (uv[triangles[:, corner]].T.astype(np.float64) for corner in range(3))
    area = 0.5 * np.abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)).sum()
    return next((size for size in TEXTURE_SIZES_PX if area * size**2 >= n_texels), TEXTURE_SIZES_PX[-1])


def _depths(fit: FaceFit, model: MorphableModel, crop: Crop) -> tuple[Camera, Float32[ndarray, "s s 3"]]:
    """Depth of whatever part of the head is in front, the nearest and the farthest around, and their camera."""
    camera = crop_camera(fit.camera, crop)
    depth = rasterise(camera.matrix, fit.vertices, model.triangles, crop.size_px, crop.size_px).depth
    here = np.minimum(depth, 1e9).astype(np.float32)
    around = np.ones((2 * STEP_REACH_PX + 1,) * 2, dtype=np.uint8)
    return camera, np.dstack([here, cv2.erode(here, around), cv2.dilate(here, around)])


def _sample(picture: ndarray, pixels: Float[ndarray, "n 2"], how: int) -> ndarray:
    """A picture at pixel positions (centres at +0.5); beyond the border 0."""
    # OpenCV's maps are pictures themselves, and of limited height and width.
    width = 4096
    rows = max(1, -(-len(pixels) // width))
    positions = np.full((rows * width, 2), -10.0, dtype=np.float32)
    positions[: len(pixels)] = np.clip(pixels - 0.5, -10, 1e6)
    columns, lines = np.moveaxis(positions.reshape(rows, width, 2), 2, 0).copy()
    sampled = cv2.remap(picture, columns, lines, how, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(sampled.reshape(rows * width, *picture.shape[2:])[: len(pixels)])


def _blend(colour: ndarray, weight: Float64[ndarray, " n"], below: ndarray) -> Float64[ndarray, "n 3"]:
    return np.asarray(weight[:, None] * colour + (1 - weight[:, None]) * below, dtype=np.float64)
