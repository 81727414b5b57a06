"""Face boxes, square crops, and conversions between the pixels of an image and of a crop."""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float64, Shaped
from numpy import ndarray

from pix2face.errors import DegenerateGeometryError
from pix2face.geometry.camera import Camera

# The middle of the jitter's 1.0 to 1.8: what a crop at inference takes of the face box, unless the checkpoint says
# otherwise.
INFERENCE_SCALE = 1.4
SMALLEST_CROP_SCALE, LARGEST_CROP_SCALE = 0.5, 5.0


@final
@dataclass(frozen=True)
class FaceBox:
    """The tight box of the projected 68 landmarks, in pixels.

    ``turn_deg`` is the angle by which the picture has to be turned anticlockwise for the face to be upright. A detector
    knows it roughly, for faces that are tilted or upside down; it is 0 for all others.
    """

    left: float
    top: float
    right: float
    bottom: float
    turn_deg: float = 0.0

    @classmethod
    def around(cls, landmarks2d: Float[ndarray, "n 2"]) -> "FaceBox":
        """The tight box of points; those that are not finite are left out.

        Raises:
            DegenerateGeometryError: Fewer than two finite points, or a box without extent.
        """
        finite = landmarks2d[np.isfinite(landmarks2d).all(axis=1)]
        if len(finite) < 2 or not np.ptp(finite, axis=0).max() > 0:
            raise DegenerateGeometryError(f"a face box needs two different points, found {len(finite)} finite ones")
        left, top = (float(value) for value in finite.min(axis=0))
        right, bottom = (float(value) for value in finite.max(axis=0))
        return cls(left, top, right, bottom)

    @property
    def sides(self) -> tuple[float, float, float, float]:
        """Left, top, right and bottom, in pixels."""
        return self.left, self.top, self.right, self.bottom

    @property
    def width(self) -> float:
        """Width in pixels."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Height in pixels."""
        return self.bottom - self.top

    @property
    def longer_side(self) -> float:
        """The longer of width and height, in pixels."""
        return max(self.width, self.height)

    @property
    def centre(self) -> Float64[ndarray, "2"]:
        """Centre (x, y) in pixels."""
        return np.array([self.left + self.right, self.top + self.bottom]) / 2


@final
@dataclass(frozen=True, eq=False)
class Crop:
    """A square picture cut out of an image by an affine map."""

    image_from_crop: Float64[ndarray, "3 3"]  #: maps homogeneous crop pixels to image pixels (centres at +0.5 in both)
    size_px: int  #: side of the square

    @property
    def crop_from_image(self) -> Float64[ndarray, "3 3"]:
        """Maps homogeneous image pixels to crop pixels."""
        return np.asarray(np.linalg.inv(self.image_from_crop), dtype=np.float64)

    @property
    def is_mirrored(self) -> bool:
        """Whether the crop shows the image with left and right exchanged."""
        return bool(np.linalg.det(self.image_from_crop[:2, :2]) < 0)

    @property
    def finest_size_px(self) -> int:
        """The side at which the crop has the resolution of the image, and at least its own side."""
        image_pixels = np.sqrt(abs(np.linalg.det(self.image_from_crop[:2, :2]))) * self.size_px
        return max(self.size_px, round(float(image_pixels)))

    def with_size(self, size_px: int) -> "Crop":
        """The same part of the image in another size."""
        ratio = self.size_px / size_px
        return Crop(self.image_from_crop @ np.diag([ratio, ratio, 1.0]), size_px)

    def to_image(self, points: Float[ndarray, "*n 2"]) -> Float64[ndarray, "*n 2"]:
        """Crop pixels to image pixels."""
        return _transform(self.image_from_crop, points)

    def to_crop(self, points: Float[ndarray, "*n 2"]) -> Float64[ndarray, "*n 2"]:
        """Image pixels to crop pixels."""
        return _transform(self.crop_from_image, points)


def square_crop(
    box: FaceBox,
    scale: float,
    size_px: int,
    *,
    shift: tuple[float, float] = (0.0, 0.0),
    rotation: float = 0.0,
    mirror: bool = False,
) -> Crop:
    """A square around a face.

    Args:
        box: The face, in image pixels.
        scale: Side of the square as a multiple of the box's longer side.
        size_px: Side of the crop in its own pixels.
        shift: Displacement of the centre as a fraction of the longer side, (right, down).
        rotation: Radians; a positive rotation turns the content of the crop anticlockwise, in addition to the turn of
            the box.
        mirror: Whether left and right are exchanged.
    """
    pixel = scale * box.longer_side / size_px
    centre = box.centre + np.asarray(shift) * box.longer_side
    angle = rotation + np.radians(box.turn_deg)
    cos, sin = np.cos(angle), np.sin(angle)
    linear = pixel * np.array([[cos, -sin], [sin, cos]])
    if mirror:
        linear[:, 0] *= -1
    image_from_crop = np.eye(3)
    image_from_crop[:2, :2] = linear
    image_from_crop[:2, 2] = centre - linear @ np.full(2, size_px / 2)
    return Crop(image_from_crop, size_px)


def image_centre_in_crop(crop: Crop, image_size_px: tuple[int, int]) -> Float64[ndarray, "2"]:
    """The centre of an image of the given height and width, in pixels of a crop: the principal point of its camera."""
    height, width = image_size_px
    return crop.to_crop(np.array([width, height]) / 2)


def pixels_in_image(crop: Crop, image_size_px: tuple[int, int]) -> Bool[ndarray, "s s"] | None:
    """Which pixels of a crop lie in the image of the given height and width; None if all do."""
    limits, side = np.array(image_size_px[::-1]), crop.size_px
    corners = crop.to_image(np.array([[0, 0], [0, side], [side, 0], [side, side]], dtype=np.float64))
    if ((corners >= 0) & (corners <= limits)).all():
        return None
    centres = np.arange(side) + 0.5
    places = crop.to_image(np.stack(np.meshgrid(centres, centres), axis=-1))
    return np.asarray(((places >= 0) & (places <= limits)).all(axis=2))


def crop_image(image: Shaped[ndarray, "h w *c"], crop: Crop, *, nearest: bool = False) -> Shaped[ndarray, "s s *c"]:
    """Resamples an image (uint8, int16 or float32) into a crop; beyond the border it is black.

    If the crop is coarser than the image, pixels are averaged first to avoid aliasing. ``nearest`` takes the nearest
    pixel instead of blending, for labels.
    """
    matrix = crop.crop_from_image[:2]
    if not nearest:
        image, matrix = _shrunk(image, matrix)
    return np.asarray(
        cv2.warpAffine(
            image,
            centres_to_integers(matrix),
            (crop.size_px, crop.size_px),
            flags=cv2.INTER_NEAREST if nearest else cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
        )
    )


def centres_to_integers(matrix: Float64[ndarray, "2 3"]) -> Float64[ndarray, "2 3"]:
    """Converts an affine map between frames with centres at +0.5 to centres at integers, as OpenCV expects it."""
    shifted = matrix.copy()
    shifted[:, 2] += matrix[:, :2] @ np.full(2, 0.5) - 0.5
    return shifted


def crop_camera(camera: Camera, crop: Crop) -> Camera:
    """The camera of the crop that shows what ``camera`` shows in the image."""
    return camera.transformed(crop.crop_from_image)


def _shrunk(image: ndarray, matrix: Float64[ndarray, "2 3"]) -> tuple[ndarray, Float64[ndarray, "2 3"]]:
    """Averages blocks of whole pixels while the crop is more than twice as coarse as the image."""
    # Beyond the longer side nothing is left to average: a huge box must not ask for a huge padding.
    factor = min(int(1 / max(np.sqrt(abs(np.linalg.det(matrix[:, :2]))), 1e-6)), max(image.shape[:2]))
    if factor < 2:
        return image, matrix
    height, width = -(-image.shape[0] // factor), -(-image.shape[1] // factor)
    padding = (height * factor - image.shape[0], width * factor - image.shape[1])
    padded = cv2.copyMakeBorder(image, 0, padding[0], 0, padding[1], cv2.BORDER_REPLICATE)
    small = cv2.resize(padded, (width, height), interpolation=cv2.INTER_AREA)
    scaled = matrix.copy()
    scaled[:, :2] *= factor
    return small, scaled


def _transform(matrix: Float64[ndarray, "3 3"], points: Float[ndarray, "*n 2"]) -> Float64[ndarray, "*n 2"]:
    return np.asarray(points @ matrix[:2, :2].T + matrix[:2, 2], dtype=np.float64)
