"""A folder as 300W-LP distributes it, and a model of BFM's size that takes its coefficients as they are: for timing."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import scipy.io
from numpy import ndarray

from pix2face.face_files.w300lp import read_coefficient_file
from pix2face.model_formats.bfm2009 import PUBLISHED_BASIS
from pix2face.models.model_file import StoredModel, write_stored_model
from tests.full_size_model import full_size_model

NATIVE_PX = 450
# About those of BFM 2009: what Shape_Para and Exp_Para are divided by.
IDENTITY_UNIT, EXPRESSION_UNIT = np.geomspace(8e5, 3e4, 199), np.geomspace(2, 0.1, 29)


def write_full_size_model(path: Path) -> Path:
    """Writes the stand-in as an imported BFM 2009 would be."""
    model = full_size_model()
    none = np.full(len(model.triangles), -1, dtype=np.int32)
    stored = StoredModel(
        name=model.name,
        licence=model.licence,
        origin=model.origin,
        mean=model.mean,
        identity_basis=model.identity_basis,
        expression_basis=model.expression_basis,
        polygons=np.column_stack([model.triangles, none]),
        polygon_regions=model.triangle_regions,
        region_names=model.region_names,
        face_regions=model.face_regions,
        landmarks=model.landmarks,
        published_basis=PUBLISHED_BASIS,
        identity_unit=IDENTITY_UNIT,
        expression_unit=EXPRESSION_UNIT,
    )
    write_stored_model(stored, path)
    return path


def write_folder(folder: Path, n: int, size_px: int, originals: Path | None) -> Path:
    """Writes n photographs with their coefficient files.

    Args:
        folder: To be made.
        n: How many.
        size_px: Side of the photographs.
        originals: A folder of 300W-LP or AFLW2000-3D that is copied, over and over; None makes faces of its own.
    """
    folder.mkdir(parents=True)
    sources = sorted(originals.glob("*.mat")) if originals else []
    texture = _texture(size_px)
    for index in range(n):
        path = folder / f"face_{index:06}.mat"
        if sources:
            _copy(sources[index % len(sources)], path, size_px)
        else:
            _invent(path, index, size_px, texture)
    return folder


def _copy(source: Path, path: Path, size_px: int) -> None:
    picture = source.with_suffix(".jpg")
    if size_px == NATIVE_PX:
        shutil.copyfile(source, path)
        shutil.copyfile(picture, path.with_suffix(".jpg"))
        return
    pose = read_coefficient_file(source).pose
    fields = {name: values for name, values in scipy.io.loadmat(source).items() if not name.startswith("__")}
    scaled = np.array(fields["Pose_Para"], dtype=np.float32)
    ratio = size_px / NATIVE_PX
    assert pose.scale == scaled[0, 6]
    scaled[0, 3:] *= ratio  # translation and scale are in pixels
    fields["Pose_Para"] = scaled
    fields.pop("pt3d_68", None)
    scipy.io.savemat(path, fields, do_compression=True)
    image = cv2.resize(cv2.imread(str(picture)), (size_px, size_px), interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(path.with_suffix(".jpg")), image, [cv2.IMWRITE_JPEG_QUALITY, 95])


def _invent(path: Path, index: int, size_px: int, texture: ndarray) -> None:
    """A head that fills half of the picture, turned by up to 80 degrees; 21 points as in AFLW2000-3D."""
    rng = np.random.default_rng(index)
    angles = rng.uniform([-0.4, -1.4, -0.4], [0.4, 1.4, 0.4])
    middle = size_px * rng.uniform(0.45, 0.55, 2)
    fields = {
        "Shape_Para": (rng.normal(size=199) * IDENTITY_UNIT)[:, None],
        "Exp_Para": (rng.normal(size=29) * EXPRESSION_UNIT)[:, None],
        "Pose_Para": np.array([[*angles, *middle, 0, 2.6e-6 * size_px]], dtype=np.float32),
        "Illum_Para": np.zeros((1, 10)),
        "Tex_Para": rng.normal(size=(199, 1)),
        "pt2d": np.full((2, 21), -1.0),
    }
    scipy.io.savemat(path, fields, do_compression=True)
    picture = np.roll(texture, rng.integers(size_px, size=2), axis=(0, 1))
    cv2.imwrite(str(path.with_suffix(".jpg")), picture, [cv2.IMWRITE_JPEG_QUALITY, 95])


def _texture(size_px: int) -> ndarray:
    """Noise that is as hard to compress as a photograph."""
    noise = np.random.default_rng(0).normal(size=(size_px, size_px, 3))
    smooth = cv2.GaussianBlur(noise, (0, 0), 2)
    return np.clip(128 + 40 * smooth / smooth.std(), 0, 255).astype(np.uint8)
