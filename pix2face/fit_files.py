"""A fit as JSON, and back (layout: docs/file_formats.md)."""

import json
from dataclasses import asdict

from pix2face.camera import head_pose, linearised, nearest_weak_perspective
from pix2face.fitting.face_fit import FaceFit
from pix2face.morphable_model import MorphableModel


def fit_to_json(fitted: FaceFit, model: MorphableModel) -> str:
    """A fit as JSON: camera, pose, coefficients and landmarks in pixels of the photograph (centres at +0.5)."""
    pose = head_pose(fitted.camera)
    return json.dumps(
        {
            "model": {"name": model.name, "sha256": model.sha256},
            "camera_matrix": fitted.camera.matrix.tolist(),
            "pose_deg": {name.removesuffix("_deg"): angle for name, angle in asdict(pose).items()},
            "px_per_mm": nearest_weak_perspective(linearised(fitted.camera)).scale,
            "identity": fitted.identity.tolist(),
            "expression": fitted.expression.tolist(),
            "landmarks2d_px": fitted.landmarks2d.tolist(),
            "landmarks3d_mm": fitted.landmarks3d.tolist(),
        },
        indent=1,
    )
