"""A fit as JSON, and back (layout: docs/reference/file_formats.md)."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.errors import InputFileError, ModelMismatchError
from pix2face.face_files.w300lp import pose_of_camera
from pix2face.files.json_text import JsonObject, read_json_file
from pix2face.fitting.face_fit import FaceFit
from pix2face.geometry.camera import Camera, head_pose, linearised, nearest_weak_perspective, pinhole_of
from pix2face.geometry.crops import FaceBox
from pix2face.geometry.other_cameras import camera_kind, colmap_camera, gltf_camera, opencv_camera
from pix2face.models.morphable_model import MorphableModel
from pix2face.photographs.landmark_visibility import visible_landmarks

# A fit of some thousand coefficients has some ten thousand characters; nothing of this size is one.
LARGEST_FILE_BYTES = 32 << 20


def fit_to_json(fitted: FaceFit, photograph: str, size_px: tuple[int, int]) -> str:
    """A fit as JSON: camera, pose, coefficients and landmarks in pixels of the photograph (centres at +0.5).

    ``photograph`` is its path, from the folder of the file if it is relative, and ``size_px`` its height and width.
    """
    pose = head_pose(fitted.camera)
    published = pose_of_camera(fitted.camera, size_px[0])
    angles = np.radians([published.head.pitch_deg, published.head.yaw_deg, published.head.roll_deg])
    return json.dumps(
        {
            "photograph": photograph,
            "box_px": None if fitted.box is None else fitted.box.sides,
            "score": fitted.score,
            "model": {"name": fitted.model.name, "sha256": fitted.model.sha256},
            "camera_kind": camera_kind(fitted.camera),
            "camera_matrix": fitted.camera.matrix.tolist(),
            "opencv": opencv_camera(fitted.camera),
            "colmap": colmap_camera(fitted.camera, size_px),
            "gltf": gltf_camera(fitted.camera, size_px),
            "focal_px": None if fitted.camera.is_affine else pinhole_of(fitted.camera).focal_px,
            "pose_deg": {name.removesuffix("_deg"): angle for name, angle in asdict(pose).items()},
            "px_per_mm": nearest_weak_perspective(linearised(fitted.camera)).scale,
            "pose_para": [*angles.tolist(), *published.translation_px.tolist(), published.scale],
            "identity": fitted.identity.tolist(),
            "expression": fitted.expression.tolist(),
            "landmarks2d_px": fitted.landmarks2d.tolist(),
            "landmarks3d_mm": fitted.landmarks3d.tolist(),
            "landmarks_visible": visible_landmarks(fitted).tolist(),
            "landmark_errors_px": None if fitted.landmark_errors_px is None else fitted.landmark_errors_px.tolist(),
            "expected_error": fitted.expected_error,
            "expected_rotation_deg": fitted.expected_rotation_deg,
        },
        indent=1,
    )


def read_fit(path: Path, model: MorphableModel) -> tuple[FaceFit, Path]:
    """Reads a file of ``fit_to_json``.

    Returns:
        The fit, in the pixels of the photograph, and where the photograph was.

    Raises:
        InputFileError: The file is missing, or no fit.
        ModelMismatchError: It is the fit of another model.
    """
    fields = read_json_file(path, JsonObject, "a fit that `pix2face fit` wrote (JSON)", LARGEST_FILE_BYTES)
    try:
        name, sha256 = str(fields["model"]["name"]), str(fields["model"]["sha256"])
        photograph = path.parent / str(fields["photograph"])
        camera = Camera(_numbers(fields, "camera_matrix", (4, 4)))
        landmarks2d = _numbers(fields, "landmarks2d_px", (-1, 2))
        landmarks3d = _numbers(fields, "landmarks3d_mm", (-1, 3))
        if sha256 != model.sha256:
            raise ModelMismatchError(
                f"{path}: a fit of the morphable model {name!r} ({sha256[:12]}), the one in use is {model.name!r} "
                f"({model.sha256[:12]}); choose the former with --model"
            )
        identity = _numbers(fields, "identity", (model.n_identity,))
        expression = _numbers(fields, "expression", (model.n_expression,))
        # Fits of earlier versions have none of these.
        errors_px = fields.get("landmark_errors_px")
        if errors_px is not None:
            errors_px = _numbers(fields, "landmark_errors_px", (len(landmarks2d),))
        box = None if fields.get("box_px") is None else FaceBox(*_numbers(fields, "box_px", (4,)).tolist())
        score = None if fields.get("score") is None else float(_numbers(fields, "score", ()))
    except (KeyError, TypeError, ValueError) as error:
        raise InputFileError(
            f"{path}: expected a fit that `pix2face fit` wrote, found one without a valid {error}; fit again"
        ) from error
    return FaceFit(camera, identity, expression, model, landmarks2d, landmarks3d, box, score, errors_px), photograph


def _numbers(fields: Mapping[str, Any], name: str, shape: tuple[int, ...]) -> Float64[ndarray, "..."]:
    """A field as finite numbers of a shape; -1 stands for any length."""
    try:
        values = np.array(fields[name], dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(repr(name)) from error
    fits = values.ndim == len(shape) and all(m in (n, -1) for n, m in zip(values.shape, shape, strict=True))
    if not fits or not np.isfinite(values).all():
        raise ValueError(repr(name))
    return values
