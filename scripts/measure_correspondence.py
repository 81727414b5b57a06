"""Measures the distance of landmarks found by correspondence from published ones: a table of docs/reference.

Also prints the rotation of BFM 2009 in the built-in model's frame (``pix2face.evaluation.subjects.measured_subject``).

python -m scripts.measure_correspondence [--shared ../shared]
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.io
from scipy.spatial.transform import Rotation

from pix2face.geometry.landmarks import IBUG68
from pix2face.geometry.rigid_alignment import fit_rigid
from pix2face.model_formats import read_model
from pix2face.model_formats.model_import import lay_by_surface
from pix2face.model_formats.tables import ibug68_vertices
from pix2face.models.model_file import StoredModel
from pix2face.models.morphable_model import builtin_model

JAW = np.arange(68) < 17


def main() -> int:
    """Measures the models and prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shared", type=Path, default=Path("../shared"))
    models = parser.parse_args().shared / "models"
    sources = {
        "BFM 2009, mean": bfm_mean(models / "bfm_mean"),
        "ICT-FaceKit": read_model(models / "ict_facekit"),
        "Surrey": read_model(models / "surrey" / "sfm_shape_3448.bin"),
    }
    print("model: surface, inside the face, jaw (mm)")
    for name, stored in sources.items():
        published = stored.landmarks[IBUG68]
        laid = lay_by_surface(replace(stored, landmarks={})).model
        if laid.alignment is None:
            print(f"{name}: no face found")
            continue
        errors = np.linalg.norm(laid.mean[laid.landmarks[IBUG68]] - laid.mean[published], axis=1)
        known = published >= 0
        inner, jaw = errors[known & ~JAW].mean(), errors[known & JAW].mean()
        print(f"{name}: {laid.alignment.residual_mm:.1f}, {inner:.1f}, {jaw:.1f}")
    own = builtin_model()
    places = own.mean[own.landmarks[IBUG68]]
    bfm = sources["BFM 2009, mean"]
    by_landmarks = fit_rigid(bfm.mean[bfm.landmarks[IBUG68]], places)[0].rotation
    angles = [round(float(angle), 2) for angle in Rotation.from_matrix(by_landmarks).as_euler("xyz", degrees=True)]
    print(f"BFM 2009 in the built-in model's frame, by 68 landmarks: turned about x, y, z by {angles} degrees")
    return 0


def bfm_mean(folder: Path) -> StoredModel:
    """Reads the mean of BFM 2009, without components."""
    info = scipy.io.loadmat(folder / "model_info.mat")
    neutral, expression = (
        np.load(folder / f"{name}.npy", allow_pickle=False).reshape(-1, 3)  # noqa: TID251
        for name in ("u_shp", "u_exp")
    )
    mean = (neutral + expression) / 1000
    triangles = info["tri"].T.astype(np.int32) - 1
    return StoredModel(
        name="BFM 2009, mean",
        licence="",
        origin="",
        mean=np.asarray(mean, dtype=np.float32),
        identity_basis=np.zeros((0, len(mean), 3), np.float32),
        expression_basis=np.zeros((0, len(mean), 3), np.float32),
        polygons=np.column_stack([triangles, np.full(len(triangles), -1, np.int32)]),
        polygon_regions=np.zeros(len(triangles), np.uint8),
        region_names=("skin",),
        face_regions=("skin",),
        landmarks={IBUG68: ibug68_vertices("bfm2009", len(mean))},
    )


if __name__ == "__main__":
    sys.exit(main())
