"""Pictures of a fitted face: overlay, maps; and its point cloud."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, UInt8
from numpy import ndarray

from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.camera import Camera, HeadPose, WeakPerspective, rotation_of_pose, weak_perspective_camera
from pix2face.geometry.crops import Crop, FaceBox, crop_camera, crop_image, square_crop
from pix2face.geometry.maps import FaceMaps, map_picture, point_cloud, smooth_maps
from pix2face.models.morphable_model import MorphableModel
from pix2face.models.rasterise import interpolate, rasterise
from pix2face.models.surface_attributes import facing

LANDMARK_COLOUR, HIDDEN_COLOUR = (60, 255, 60), (255, 80, 80)
# How many times as large as the radius of a dot a face is; the smallest radius is one pixel.
FACE_PER_RADIUS = 150
LARGEST_PX = 1e6  # OpenCV takes 32-bit pixels
# The NumPy rasteriser is exact and slow; an overlay needs no more than this.
OVERLAY_PX, OVERLAY_SCALE = 512, 2.0
PICTURE_LIMITS_MM = (120.0, 15.0)
MAPS_PX = 512  # side of a picture of maps at most
# Side of the maps that a cloud of points comes from: its points look like a surface from any side.
CLOUD_PX = 256
FADED = 0.25  # contrast of the photograph behind drawn maps
LETTER_SCALE, LETTER_PX = 0.36, 10  # of OpenCV's font, and the height of its letters at this scale


def draw_landmarks(
    image: UInt8[ndarray, "h w 3"],
    landmarks2d: Float[ndarray, "m 2"],
    colour: tuple[int, int, int] = LANDMARK_COLOUR,
    in_sight: Bool[ndarray, " m"] | None = None,
) -> UInt8[ndarray, "h w 3"]:
    """A copy of a picture with a dot on every landmark, small beside the face; red where it is not in sight."""
    picture = image.copy()
    is_known = (np.abs(landmarks2d) < LARGEST_PX).all(axis=1)  # neither NaN nor infinity
    known = landmarks2d[is_known]
    shown = np.ones(len(known), dtype=bool) if in_sight is None else in_sight[is_known]
    radius = max(1, round(float(np.ptp(known, axis=0).max(initial=0)) / FACE_PER_RADIUS)) if len(known) else 1
    edge = cv2.LINE_AA if radius > 1 else cv2.LINE_8  # smoothed, the smallest dot would be three times as large
    for (x, y), is_shown in zip(np.floor(known).astype(int).tolist(), shown, strict=True):
        cv2.circle(picture, (x, y), radius, colour if is_shown else HIDDEN_COLOUR, -1, edge)
    return picture


def draw_box(
    picture: UInt8[ndarray, "h w 3"], box: FaceBox, score: float | None, colour: tuple[int, int, int] = LANDMARK_COLOUR
) -> None:
    """Draws a face box into a picture, with its score above it if it has one."""
    left, top, right, bottom = (int(side) for side in np.clip(box.sides, -LARGEST_PX, LARGEST_PX))
    cv2.rectangle(picture, (left, top), (right, bottom), colour, 1, cv2.LINE_AA)
    if score is not None:
        place = (max(left, 0), max(top - 4, LETTER_PX))
        cv2.putText(picture, f"{score:.2f}", place, cv2.FONT_HERSHEY_SIMPLEX, LETTER_SCALE, colour, 1, cv2.LINE_AA)


def draw_overlay(
    image: UInt8[ndarray, "h w 3"],
    fit: FaceFit,
    size_px: int = OVERLAY_PX,
    in_sight: Bool[ndarray, " m"] | None = None,
) -> UInt8[ndarray, "s s 3"]:
    """The fitted face, shaded, over its part of the picture, with landmarks, box and score; it shows twice the face.

    Landmarks are green; those that are not ``in_sight``, if it is given, are red.

    Raises:
        DegenerateGeometryError: The landmarks have no extent.
    """
    crop = square_crop(FaceBox.around(fit.landmarks2d), OVERLAY_SCALE, size_px)
    camera, background = crop_camera(fit.camera, crop), crop_image(image, crop)
    blend = shaded_face(background, fit.vertices, fit.model, camera)
    overlay = draw_landmarks(blend, crop.to_crop(fit.landmarks2d), in_sight=in_sight)
    if fit.box is not None:
        left, top, right, bottom = fit.box.sides
        corners = crop.to_crop(np.array([[left, top], [right, bottom]]))
        draw_box(overlay, FaceBox(*corners.ravel().tolist()), fit.score)
    return overlay


def shaded_face(
    background: UInt8[ndarray, "h w 3"], vertices: Float[ndarray, "v 3"], model: MorphableModel, camera: Camera
) -> UInt8[ndarray, "h w 3"]:
    """A face (mm, model frame), shaded and half transparent, over a picture in whose pixels the camera projects."""
    height, width = background.shape[:2]
    triangles = model.triangles[model.is_face_triangle]
    fragments = rasterise(camera.matrix, vertices, triangles, height, width)
    shade = interpolate(fragments, facing(vertices, triangles, camera)[:, None], triangles)
    painted = np.clip(shade, 0.15, 1) * np.array([150.0, 190.0, 255.0])
    covered = (fragments.triangle >= 0)[..., None]
    return np.where(covered, 0.5 * background + 0.5 * painted, background).astype(np.uint8)


def draw_maps(image: UInt8[ndarray, "h w 3"], crop: Crop, maps: FaceMaps) -> UInt8[ndarray, "s s3 3"]:
    """The crop that predicted maps belong to, PNCC and offset side by side, at most ``MAPS_PX`` large.

    The resolution is that of the picture, and at least that of the maps.
    """
    photograph = crop_image(image, crop.with_size(min(crop.finest_size_px, MAPS_PX)))
    return np.hstack([photograph, *maps_over(photograph, maps)])


def maps_over(photograph: UInt8[ndarray, "s s 3"], maps: FaceMaps) -> list[UInt8[ndarray, "s s 3"]]:
    """Predicted PNCC and offset over a crop, faded; x, y, z as red, green, blue. Holes of the mask are closed."""
    smooth = smooth_maps(maps, len(photograph), has_holes=False)
    # Fades out within the mask, since there are no values beyond it.
    edge = np.clip(2 * cv2.GaussianBlur(smooth.mask.astype(np.float32), (0, 0), 1.0) - 1, 0, 1)[..., None]
    faded = 255 - FADED * (255 - photograph.mean(axis=2, keepdims=True))
    everywhere = np.ones(smooth.mask.shape, dtype=bool)
    return [
        (edge * map_picture(values, everywhere, limit) + (1 - edge) * faded).astype(np.uint8)
        for values, limit in zip((smooth.pncc, smooth.offset), PICTURE_LIMITS_MM, strict=True)
    ]


def photograph_cloud(
    image: UInt8[ndarray, "h w 3"], crop: Crop, maps: FaceMaps
) -> tuple[Float32[ndarray, "n 3"], UInt8[ndarray, "n 3"]]:
    """PNCC + offset of every pixel of a face (mm, model frame) and its colour, in a crop of ``CLOUD_PX``."""
    return point_cloud(smooth_maps(maps, CLOUD_PX), crop_image(image, crop.with_size(CLOUD_PX)))


YAWS_DEG = (0.0, 45.0, 90.0)
PANEL_PX = 640
# A face of some 240 mm, chin to hair line, with a margin.
MM_A_PANEL = 280.0
COLOURS = ((20, 140, 20), (210, 40, 40))


def draw_model_landmarks(model: MorphableModel, choices: list[Float64[ndarray, "_ 3"]]) -> UInt8[ndarray, "h w 3"]:
    """The mean face, frontal, half turned and in profile, with landmarks.

    Of ``choices``, up to two lists of points (mm, model frame), the first is drawn in green and the second in red.
    """
    panels = []
    face = model.mean[model.is_face_vertex]
    middle = (face.min(axis=0) + face.max(axis=0)) / 2
    for yaw_deg in YAWS_DEG:
        rotation = rotation_of_pose(HeadPose(0, yaw_deg, 0))
        scale = PANEL_PX / MM_A_PANEL
        camera = weak_perspective_camera(
            WeakPerspective(scale, rotation, np.full(2, PANEL_PX / 2) - scale * (rotation @ middle)[:2])
        )
        panel = shaded_face(np.full((PANEL_PX, PANEL_PX, 3), 255, np.uint8), model.mean, model, camera)
        for points, colour in zip(choices, COLOURS, strict=False):
            for number, (x, y) in enumerate(camera.project(points)):
                place = (round(float(x)), round(float(y)))
                cv2.circle(panel, place, 2, colour, -1, cv2.LINE_AA)
                beside = (place[0] + 3, place[1] - 3)
                cv2.putText(panel, str(number), beside, cv2.FONT_HERSHEY_SIMPLEX, LETTER_SCALE, colour, 1, cv2.LINE_AA)
        panels.append(panel)
    return np.hstack(panels)
