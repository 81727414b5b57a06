"""The mistakes: half pixels, swapped axes, signs, order of rotations, rows for columns, 0- for 1-based.

Each is one replacement of text. The text must occur exactly once below its folder, so a mistake survives a move of
code from file to file, and one that no longer applies is an error instead of a silent success.
"""

from dataclasses import dataclass
from typing import final


@final
@dataclass(frozen=True)
class Mistake:
    """One mistake.

    Attributes:
        name: What goes wrong.
        folder: Where the text is, from the root of the repository.
        before: The text as it is.
        after: The text with the mistake.
        tests: What has to fail, from the root of the repository.
    """

    name: str
    folder: str
    before: str
    after: str
    tests: str


GEOMETRY, TRAINING, RENDERING = "tests/pix2face/geometry", "tests/training", "tests/datagen/rendering"
FACE_FILES, MODELS, FITTING = "tests/pix2face/face_files", "tests/pix2face/models", "tests/pix2face/fitting"
INFERENCE = "tests/pix2face/inference"
PHOTOGRAPHS, EVALUATION, SAMPLES = "tests/pix2face/photographs", "tests/pix2face/evaluation", "tests/datagen/samples"

# fmt: off
# ruff: noqa: E501
MISTAKES = (
    # Cameras and poses.
    Mistake("camera: rows for columns of the projection", "pix2face/geometry",
            "points @ self.matrix[[0, 1, 3], :3].T +", "points @ self.matrix[:3, [0, 1, 3]] +", GEOMETRY),
    Mistake("camera: depth grows towards the viewer", "pix2face/geometry",
            "matrix[2, :3] = parameters.rotation[2]", "matrix[2, :3] = -parameters.rotation[2]", GEOMETRY),
    Mistake("camera: y and z are not turned over", "pix2face/geometry",
            "FRONTAL = np.diag([1.0, -1.0, -1.0])", "FRONTAL = np.diag([1.0, 1.0, 1.0])", GEOMETRY),
    Mistake("camera: an affine camera looks from behind", "pix2face/geometry",
            "axis = np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])",
            "axis = np.array([az * by - ay * bz, ax * bz - az * bx, ay * bx - ax * by])", GEOMETRY),
    Mistake("camera: a crop moves the principal point of a pinhole without its depth", "pix2face/geometry",
            "np.outer(image_from_image[:2, 2], self.matrix[3])", "np.outer(image_from_image[:2, 2], [0, 0, 0, 1])",
            GEOMETRY),
    Mistake("pose: yaw turns to the other side", "pix2face/geometry",
            "angles = [-pose.pitch_deg, -pose.yaw_deg, -pose.roll_deg]",
            "angles = [-pose.pitch_deg, pose.yaw_deg, -pose.roll_deg]", GEOMETRY),
    Mistake("pose: roll turns to the other side", "pix2face/geometry",
            "angles = [-pose.pitch_deg, -pose.yaw_deg, -pose.roll_deg]",
            "angles = [-pose.pitch_deg, -pose.yaw_deg, pose.roll_deg]", GEOMETRY),
    Mistake("pose: Rz Ry Rx instead of Rx Ry Rz", "pix2face/geometry",
            "FRONTAL @ np.array(turn)", "FRONTAL @ np.array(turn).T", GEOMETRY),
    Mistake("pose: the angle found has the wrong sign of yaw", "pix2face/geometry",
            "yaw = -math.atan2(r[0][2], cos_yaw)", "yaw = math.atan2(r[0][2], cos_yaw)", GEOMETRY),
    # Crops and jitter.
    Mistake("crop: half a pixel between crops and OpenCV", "pix2face/geometry",
            "matrix[:, :2] @ np.full(2, 0.5) - 0.5", "matrix[:, :2] @ np.full(2, 0.0)", GEOMETRY),
    Mistake("crop: height for width of the image's limits", "pix2face/geometry",
            "np.array(image_size_px[::-1]), crop.size_px", "np.array(image_size_px), crop.size_px", GEOMETRY),
    Mistake("crop: height for width of the image's centre", "pix2face/geometry",
            "crop.to_crop(np.array([width, height]) / 2)", "crop.to_crop(np.array([height, width]) / 2)", GEOMETRY),
    Mistake("crop: the other sense of rotation", "pix2face/geometry",
            "np.array([[cos, -sin], [sin, cos]])", "np.array([[cos, sin], [-sin, cos]])", GEOMETRY),
    Mistake("crop: shift is (down, right)", "pix2face/geometry",
            "centre = box.centre + np.asarray(shift) *", "centre = box.centre + np.asarray(shift)[::-1] *", GEOMETRY),
    Mistake("crop: half a pixel at its corner", "pix2face/geometry",
            "np.full(2, size_px / 2)", "np.full(2, (size_px - 1) / 2)", GEOMETRY),
    Mistake("crop: height for width where a picture is shrunk", "pix2face/geometry",
            "cv2.resize(padded, (width, height)", "cv2.resize(padded, (height, width)", GEOMETRY),
    Mistake("crop: padding of the other side where a picture is shrunk", "pix2face/geometry",
            "(image, 0, padding[0], 0, padding[1]",
            "(image, 0, padding[1], 0, padding[0]", GEOMETRY),
    Mistake("maps: a cell forgets its lower side", "pix2face/geometry",
            "|= across[1:] | down[:, 1:]", "|= down[:, 1:]", GEOMETRY),
    Mistake("maps: the nearest pixel is found with columns for rows", "pix2face/geometry",
            "found = np.floor(points).astype(np.int64)[:, ::-1]", "found = np.floor(points).astype(np.int64)", GEOMETRY),
    Mistake("maps: half a pixel at the nearest pixel", "pix2face/geometry",
            "crop.to_image(np.stack([columns, rows], axis=1) + 0.5)", "crop.to_image(np.stack([columns, rows], axis=1))",
            GEOMETRY),
    Mistake("maps: a mirrored crop keeps the sign of x", "pix2face/geometry",
            "        if crop.is_mirrored:\n", "        if False:\n", GEOMETRY),
    Mistake("maps: cells over steps stand half a pixel off", "pix2face/geometry",
            "centre_px=1.0", "centre_px=0.5", GEOMETRY),
    # Landmarks and metrics.
    Mistake("landmarks: 0- for 1-based annotations", "pix2face/geometry",
            "ONE_BASED_TO_CENTRES_PX: Final = -0.5", "ONE_BASED_TO_CENTRES_PX: Final = 0.5", FACE_FILES),
    Mistake("metrics: the box's width twice", "pix2face/geometry",
            "np.sqrt(width * height)", "np.sqrt(width * width)", GEOMETRY),
    Mistake("alignment: a reflection passes for a rotation", "pix2face/geometry",
            "signs = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])", "signs = np.array([1, 1, 1])", GEOMETRY),
    # Files of others.
    Mistake("300W-LP: one pixel in y of the camera", "pix2face/face_files",
            "image_height_px - pose.translation_px[1] + 0.5", "image_height_px - pose.translation_px[1] - 0.5",
            FACE_FILES),
    Mistake("300W-LP: one pixel in x of the camera", "pix2face/face_files",
            "pose.translation_px[0] - 0.5", "pose.translation_px[0] + 0.5", FACE_FILES),
    Mistake("300W-LP: one pixel in y of Pose_Para", "pix2face/face_files",
            "image_height_px - ty + 0.5", "image_height_px - ty - 0.5", FACE_FILES),
    Mistake("300W-LP: half a pixel in pt3d_68", "pix2face/face_files",
            "[0.5, 0.5, 0]", "[0.0, 0.0, 0]", FACE_FILES),
    Mistake("300W-LP: a negative scale keeps its rotation", "pix2face/face_files",
            "rotation = np.diag([-1.0, -1.0, 1.0]) @ rotation", "rotation = rotation", FACE_FILES),
    Mistake("dlib: half a pixel in XML annotations", "pix2face/face_files",
            "return mark_missing(points) + 0.5", "return mark_missing(points)", FACE_FILES),
    Mistake("AFLW: half a pixel in the 21 points", "pix2face/face_files",
            "np.where(missing, np.nan, points + ONE_BASED_TO_CENTRES_PX)", "np.where(missing, np.nan, points)", FACE_FILES),
    # Rasteriser, models.
    Mistake("rasteriser: height for width of the picture's limits", "pix2face/models",
            "limit = np.array([width, height])", "limit = np.array([height, width])", MODELS),
    Mistake("normals: towards the viewer instead of away", "pix2face/models",
            "axes[2] *= np.sign(", "axes[2] *= -np.sign(", MODELS),
    Mistake("rasteriser: half a pixel at pixel centres", "pix2face/models",
            "to_x, to_y = column.take(inside) + 0.5 -", "to_x, to_y = column.take(inside) + 0.0 -", MODELS),
    Mistake("rasteriser: no perspective correction", "pix2face/models",
            "true_weights /= w.take(covering, axis=1)", "true_weights /= 1.0", MODELS),
    Mistake("rasteriser: the outside is the inside", "pix2face/models",
            "_doubled_area(screen) * handedness(camera) < 0", "_doubled_area(screen) * handedness(camera) > 0", MODELS),
    Mistake("mirroring: y instead of x", "pix2face/models",
            "points * np.array([-1, 1, 1]", "points * np.array([1, -1, 1]", MODELS),
    Mistake("mirroring: landmarks keep their order", "pix2face/models",
            "return landmarks[list(MIRROR_IBUG68)]", "return landmarks", MODELS),
    Mistake("landmarks: without the offsets from their vertices", "pix2face/models",
            "self.landmark_offsets_mm.get(scheme, np.zeros(3))", "np.zeros(3)", FITTING + "/test_landmark_types.py"),
    Mistake("landmarks: the offsets of a pair do not mirror each other", "pix2face/landmark_choice",
            "right + MIRROR * right[list(mirror)]", "right + right[list(mirror)]", "tests/pix2face/landmark_choice"),
    Mistake("Surrey: rows for columns of a matrix", "pix2face/model_formats",
            ".reshape(columns, rows).T", ".reshape(rows, columns)", "tests/pix2face/model_formats/test_our_files.py"),
    # Fitting.
    Mistake("affine camera: the transposed linear part", "pix2face/fitting",
            "(x * share[:, None]).T @ u).T", "(x * share[:, None]).T @ u)[[1, 0, 2]].T", FITTING + "/cameras"),
    Mistake("similarity: the sign of a rotation's derivative", "pix2face/fitting",
            "out[:, 0, 1], out[:, 0, 2] = z, -y", "out[:, 0, 1], out[:, 0, 2] = -z, y", FITTING + "/least_squares"),
    Mistake("localise: half a pixel at vertices", "pix2face/fitting",
            "np.column_stack([columns, rows])[seen] + 0.5 + step[seen]", "np.column_stack([columns, rows])[seen] + step[seen]",
            FITTING + "/test_localise.py"),
    Mistake("localise: columns for rows", "pix2face/fitting",
            "np.column_stack([columns, rows])[seen] + 0.5 + step[seen]",
            "np.column_stack([rows, columns])[seen] + 0.5 + step[seen]", FITTING + "/test_localise.py"),
    Mistake("fit: half a pixel at surface pixels", "pix2face/fitting",
            "return points3d, np.column_stack([columns, rows]) + 0.5", "return points3d, np.column_stack([columns, rows])",
            FITTING + "/test_surface_pixels.py"),
    Mistake("silhouette: half a pixel of the distance", "pix2face/fitting",
            "self.reach_px - 0.5", "self.reach_px + 0.5", FITTING + "/test_silhouette.py"),
    Mistake("silhouette: the slope's axes are swapped", "pix2face/fitting",
            "np.array([across_above + (across_below - across_above) * down, below - above])",
            "np.array([below - above, across_above + (across_below - across_above) * down])",
            FITTING + "/test_silhouette.py"),
    # Photographs.
    Mistake("texture: half a pixel at vertices", "pix2face/photographs",
            "np.clip(pixels - 0.5, -10, 1e6)", "np.clip(pixels, -10, 1e6)", PHOTOGRAPHS + "/test_texture.py"),
    Mistake("texture: v runs down", "pix2face/photographs",
            "(1 - model.uv[:, 1]) * size_px", "model.uv[:, 1] * size_px", PHOTOGRAPHS + "/test_texture.py"),
    Mistake("texture: the back of the head faces the viewer", "pix2face/models",
            "towards = -camera.matrix[2, :3]", "towards = camera.matrix[2, :3]", PHOTOGRAPHS + "/test_texture.py"),
    Mistake("networks: half a pixel where planes are enlarged", "pix2face/inference",
            'coordinate_transformation_mode="half_pixel"', 'coordinate_transformation_mode="asymmetric"', INFERENCE + "/test_onnx_files.py"),
    Mistake("networks: mean of a norm lost", "pix2face/inference",
            "shift = centre - mean * gain / deviation", "shift = centre", INFERENCE + "/test_onnx_files.py"),
    Mistake("correction: from the corner of the crop", "pix2face/inference",
            "rows[:, 3] -= 0.5", "rows[:, 3] -= 0.0", INFERENCE + "/test_fit_correction.py"),
    Mistake("correction: a turn to the other side", "pix2face/inference",
            "cv2.Rodrigues(TURN * changes[:3])", "cv2.Rodrigues(-TURN * changes[:3])", INFERENCE + "/test_fit_correction.py"),
    Mistake("refinement: half a pixel at the residual", "pix2face/photographs",
            "centres = np.column_stack([columns, rows]) + 0.5", "centres = np.column_stack([columns, rows])", PHOTOGRAPHS + "/test_refined_detection.py"),
    Mistake("refinement: the box stays in the crop's pixels", "pix2face/photographs",
            "FaceBox.around(prediction.crop.to_image(fit.landmarks2d))", "FaceBox.around(fit.landmarks2d)", PHOTOGRAPHS + "/test_refined_detection.py"),
    Mistake("tilt: to the other side", "pix2face/inference",
            "np.arctan2(right, -down)", "np.arctan2(-right, -down)", INFERENCE + "/test_predictor.py"),
    Mistake("tilt: the upright crop is that of an upright picture", "pix2face/inference",
            "prediction.crop.image_from_crop @ from_turned @", "from_turned @", INFERENCE + "/test_predictor.py"),
    Mistake("turned pictures: boxes where they are found", "pix2face/detectors",
            "centre = back @ [*face.box.centre, 1]", "centre = face.box.centre", "tests/pix2face/detectors/test_centre_detector.py"),
    # Ground truth.
    Mistake("landmarks seen: rows for columns", "datagen/rendering",
            "column, row = np.floor(camera.project(points)).astype(np.int64).T",
            "row, column = np.floor(camera.project(points)).astype(np.int64).T", RENDERING + "/test_renderer.py"),
    Mistake("drawn face: shift is (down, right)", "datagen/sampling",
            "centre = box.centre + np.asarray(view.shift) *", "centre = box.centre + np.asarray(view.shift)[::-1] *",
            "tests/datagen/sampling/test_sampling_views.py"),
    Mistake("drawn face: the off-axis turn goes the other way", "datagen/sampling",
            "axis = np.array([-ray[1], ray[0], 0.0])", "axis = np.array([ray[1], -ray[0], 0.0])", "tests/datagen/sampling/test_sampling_views.py"),
    Mistake("bystanders: half a pixel at their place", "datagen/samples",
            "shift[0] + 0.5 * scale - 0.5", "shift[0]", SAMPLES + "/test_bystanders.py"),
    Mistake("bystanders: x and y of their place are swapped", "datagen/samples",
            "np.array([place.x * width, place.y * height])", "np.array([place.y * width, place.x * height])", SAMPLES + "/test_bystanders.py"),
    # Training.
    Mistake("loader: the middle's row for its column", "training/data",
            "return (width - size_px) // 2, (height - size_px) // 2", "return (height - size_px) // 2, (width - size_px) // 2",
            TRAINING + "/data/test_dataset.py"),
    Mistake("loader: a mirrored cut keeps the sign of x", "training/data",
            "np.negative(steps[..., 0], out=steps[..., 0])", "np.negative(steps[..., 1], out=steps[..., 1])",
            TRAINING + "/data/test_dataset.py"),
    Mistake("loader: the cut's corner is (row, column)", "training/data",
            "corner=(face[1].start, face[0].start)", "corner=(face[0].start, face[1].start)", TRAINING + "/data/test_cropping.py"),
    Mistake("loader: halved landmarks are half a pixel off", "training/data",
            "landmarks2d=sample.landmarks2d / 2", "landmarks2d=(sample.landmarks2d - 0.5) / 2", TRAINING + "/data/test_halving.py"),
    # Evaluation.
    Mistake("predictions: 0- for 1-based", "pix2face/evaluation",
            '"0-based": 0.5, "1-based": -0.5', '"0-based": -0.5, "1-based": 0.5', EVALUATION + "/subjects/test_predictions_file.py"),
    # Corrections of fits.
    Mistake("correction: a mirrored face keeps its camera", "training/correction",
            "camera.matrix * [-1, 1, 1, 1]", "camera.matrix * [1, 1, 1, 1]", TRAINING + "/correction"),
    Mistake("correction: places are counted from the corner of the crop", "pix2face/inference",
            "rows[:, 3] -= 0.5", "rows[:, 3] -= 0.0", "tests/pix2face/inference"),
    Mistake("correction: the system keeps its solution", "pix2face/fitting",
            "replace(system, right=right)", "system", FITTING),
    Mistake("correction: turns are those of the inverse rotation", "pix2face/networks",
            "rotation_of(TURN * changes[:, :3]) @ rotation", "rotation_of(TURN * changes[:, :3]).mT @ rotation", "tests/pix2face/networks"),
)
