"""Benchmarks of photographs: a picture beside its annotation, in the folders that they are distributed in."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.errors import InputFileError, UsageError
from pix2face.evaluation.benchmarks.benchmark_data import (
    BenchmarkFace,
    BenchmarkFiles,
    BenchmarkItem,
    complete,
    picture_reader,
    wrap_angle_deg,
    yaw_bin,
)
from pix2face.evaluation.benchmarks.manifest import BenchmarkPart, Manifest
from pix2face.face_files.w300lp import check_picture_height, read_coefficient_file
from pix2face.files.images import read_size_px
from pix2face.files.npz_files import read_npy
from pix2face.geometry.landmarks import ONE_BASED_TO_CENTRES_PX, read_pts

# Landmarks by file name, in place of those beside the pictures.
OtherLandmarks = Mapping[str, Float64[ndarray, "68 2"]]

LARGEST_LANDMARKS_BYTES = 64 << 20  # of re-annotated landmarks; those of AFLW2000-3D have 3 MB


def find_photographs(manifest: Manifest, data: Path, reannotated: Path | None = None) -> BenchmarkFiles:
    """The pictures of a split below a folder. ``reannotated`` is as for ``find_benchmark``.

    Raises:
        UsageError: Re-annotated landmarks are wanted and not found, or are of another number of pictures.
        InputFileError: They cannot be read.
    """
    items: list[BenchmarkItem] = []
    missing: list[str] = []
    absent: list[str] = []
    suffix = ".mat" if manifest.kind == "w300lp-mat" else ".pts"
    for part in manifest.parts:
        folder = _folder_of_part(manifest, data, part)
        if folder is None:
            names = [f"{part.name}/{image_name}" for image_name in part.image_names]
            missing += names
            absent += names
            continue
        other = _reannotated(manifest, part, folder, reannotated) if manifest.truth == "reannotated" else None
        for image_name in part.image_names:
            name = f"{part.name}/{image_name}"
            image, truth = folder / image_name, (folder / image_name).with_suffix(suffix)
            lacking = [path.name for path in (image, truth) if not path.is_file()]
            if lacking:
                missing.append(name if len(lacking) == 2 else f"{name} (no {lacking[0]})")
                absent.append(name)
            elif manifest.kind == "w300lp-mat":
                items.append(BenchmarkItem(name, partial(_read_w300lp_face, name, image, truth, other)))
            else:
                items.append(BenchmarkItem(name, partial(_read_pts_face, name, part.name, image, truth)))
    return BenchmarkFiles(tuple(items), tuple(missing), absent_names=tuple(absent))


def _folder_of_part(manifest: Manifest, data: Path, part: BenchmarkPart) -> Path | None:
    """The first folder that holds a picture of the part. Sets that share file names are never mixed."""
    candidates = (data / home / folder for home in manifest.homes for folder in part.folders)
    names = set(part.image_names)
    for folder in candidates:
        if folder.is_dir() and any(path.name in names for path in folder.iterdir()):
            return folder
    return None


def _reannotated(manifest: Manifest, part: BenchmarkPart, folder: Path, given: Path | None) -> OtherLandmarks:
    """Re-annotated landmarks by file name of the picture, in the project's pixels.

    The file has no names. Its landmarks are of all pictures of the benchmark in their order, or of those in the folder.
    """
    candidates = [place / name for place in (folder, folder.parent) for name in manifest.reannotated_files]
    path = given or next((candidate for candidate in candidates if candidate.is_file()), None)
    if path is None:
        known = " or ".join(manifest.reannotated_files)
        raise UsageError(
            f"{manifest.split}: expected re-annotated landmarks ({known}) in {folder} "
            "or beside it, found none; pass --reannotated FILE, or --truth original"
        )
    landmarks = _read_npy_landmarks(path)
    at_hand = sorted(name for name in part.image_names if (folder / name).is_file())
    names: Sequence[str] = part.image_names if len(landmarks) == len(part.image_names) else at_hand
    if len(landmarks) != len(names):
        raise UsageError(
            f"{path}: expected landmarks of all {len(part.image_names)} pictures of {manifest.split} or of the "
            f"{len(at_hand)} in {folder}, found {len(landmarks)}"
        )
    return dict(zip(names, landmarks, strict=True))


def _read_npy_landmarks(path: Path) -> Float64[ndarray, "n 68 2"]:
    points = read_npy(path, "a .npy file of landmarks", LARGEST_LANDMARKS_BYTES)
    if points.ndim != 3 or points.shape[1:] not in ((2, 68), (3, 68)) or points.dtype.kind not in "fiu":
        raise UsageError(
            f"{path}: expected landmarks of shape (n, 2, 68), found shape {points.shape} and type {points.dtype}"
        )
    return np.swapaxes(points[:, :2], 1, 2).astype(np.float64) + ONE_BASED_TO_CENTRES_PX


def _read_pts_face(name: str, group: str, image: Path, truth: Path) -> BenchmarkFace:
    landmarks2d = complete(read_pts(truth), truth)
    return BenchmarkFace(name=name, group=group, landmarks2d=landmarks2d, read_image=picture_reader(image))


def _read_w300lp_face(name: str, image: Path, truth: Path, other: OtherLandmarks | None) -> BenchmarkFace:
    file = read_coefficient_file(truth)
    if file.landmarks3d is None:
        raise InputFileError(f"{truth}: expected the landmarks pt3d_68, found none; is this a file of AFLW2000-3D?")
    size_px = None
    with suppress(InputFileError):  # a damaged picture is told by what looks at it
        size_px = read_size_px(image)
    if size_px is not None:
        check_picture_height(file, size_px[0])
    head = file.pose.head
    yaw_deg = wrap_angle_deg(head.yaw_deg)
    landmarks2d = complete(file.landmarks3d[:, :2], truth) if other is None else other[image.name]
    landmarks3d = file.landmarks3d * [1, 1, -1] if other is None else None  # towards the viewer, as in the file
    if not np.isfinite(landmarks2d).all():
        raise InputFileError(f"{image.name}: expected finite re-annotated landmarks, found NaN or infinity")
    return BenchmarkFace(
        name=name,
        group=yaw_bin(yaw_deg),
        landmarks2d=landmarks2d,
        landmarks3d=landmarks3d,
        read_image=picture_reader(image),
        yaw_deg=yaw_deg,
        has_unusual_angle=file.pose.is_unusual,  # such faces are kept and counted
        # A negative scale turns the face inside out: its angles are not those of the head in the picture.
        pose=None if file.pose.is_unusual or file.pose.scale < 0 else head,
    )
