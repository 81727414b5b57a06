"""The files of a benchmark: which are there, which are missing, and how each is read into a picture with its truth."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float64, UInt8
from numpy import ndarray

from pix2face.camera import head_pose
from pix2face.errors import InputFileError, ModelMismatchError, UsageError
from pix2face.face_maps import FaceMaps
from pix2face.images import decode_image, read_bytes
from pix2face.landmarks import read_pts
from pix2face.manifest import BenchmarkPart, Manifest
from pix2face.morphable_model import MorphableModel
from pix2face.shards import ShardReader, shard_paths
from pix2face.w300lp import read_coefficient_file

YAW_BINS = ("|yaw| <= 30°", "30° < |yaw| <= 60°", "|yaw| > 60°")
YAW_EDGES_DEG = (30.0, 60.0)
# Beyond this the annotation of AFLW2000-3D is known to be unreliable; such faces are kept and counted.
USUAL_ANGLE_DEG = 99.0


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class BenchmarkFace:
    """A picture and its truth.

    Attributes:
        name: What lists call it.
        group: The column of the table that it counts in.
        image: RGB.
        landmarks2d: True landmarks, pixels.
        yaw_deg: Yaw of the head, wrapped to ±180, where the truth knows it.
        has_unusual_angle: Whether one of pitch, yaw, roll is beyond ±99° as stored.
        maps: True maps, where the truth knows them.
    """

    name: str
    group: str
    image: UInt8[ndarray, "h w 3"]
    landmarks2d: Float64[ndarray, "68 2"]
    yaw_deg: float | None = None
    has_unusual_angle: bool = False
    maps: FaceMaps | None = None


@final
@dataclass(frozen=True)
class BenchmarkItem:
    """A face that is complete on disk and not yet read.

    Attributes:
        name: What lists call it.
        load: Reads it; raises InputFileError where its files are damaged.
    """

    name: str
    load: Callable[[], BenchmarkFace]


@final
@dataclass(frozen=True)
class Unreadable:
    """A face whose files are there and cannot be used."""

    name: str
    reason: str


@final
@dataclass(frozen=True)
class BenchmarkFiles:
    """What was found of a split.

    Attributes:
        items: Complete faces.
        missing: Names of the faces that are not there, each with what is missing.
        unreadable: Whole files that cannot be opened (damaged shards).
    """

    items: tuple[BenchmarkItem, ...]
    missing: tuple[str, ...]
    unreadable: tuple[Unreadable, ...]


def find_benchmark(manifest: Manifest, data: Path | None, model: MorphableModel) -> BenchmarkFiles:
    """Looks for the files of a split below a folder.

    Args:
        manifest: The split.
        data: Where its files are; None where nobody said.
        model: The model in use: maps of another one cannot be compared.

    Raises:
        UsageError: There is nothing of the split, or shards of other faces; says where it is to be had.
        ModelMismatchError: Shards of another model.
    """
    if data is None:
        raise UsageError(
            f"{manifest.split} ({manifest.title}) needs its data: pass --data DATA or set PIX2FACE_DATA. "
            f"{manifest.how_to_get_it}"
        )
    found = _find_shards(manifest, data, model) if manifest.kind == "shards" else _find_photographs(manifest, data)
    if not found.items and not found.unreadable:
        what = "none of its faces complete" if data.is_dir() else "no such folder"
        raise UsageError(
            f"{data}: expected the data of {manifest.split} ({manifest.title}), found {what}. {manifest.how_to_get_it}"
        )
    return found


def yaw_bin(yaw_deg: float) -> str:
    """The column of the table for a yaw angle (wrapped)."""
    return YAW_BINS[int(np.searchsorted(YAW_EDGES_DEG, abs(yaw_deg), side="left"))]


def wrap_angle_deg(angle_deg: float) -> float:
    """An angle brought to [-180, 180)."""
    return (angle_deg + 180) % 360 - 180


def _find_photographs(manifest: Manifest, data: Path) -> BenchmarkFiles:
    items: list[BenchmarkItem] = []
    missing: list[str] = []
    for part in manifest.parts:
        folder = _folder_of_part(manifest, data, part)
        for image_name in part.image_names:
            name = f"{part.name}/{image_name}"
            if folder is None:
                missing.append(name)
                continue
            image, truth = folder / image_name, (folder / image_name).with_suffix(_truth_suffix(manifest))
            lacking = [path.name for path in (image, truth) if not path.is_file()]
            if lacking:
                missing.append(name if len(lacking) == 2 else f"{name} (no {lacking[0]})")
            else:
                read = _read_w300lp_face if manifest.kind == "w300lp-mat" else _read_pts_face
                items.append(BenchmarkItem(name, partial(read, name, part.name, image, truth)))
    return BenchmarkFiles(tuple(items), tuple(missing), ())


def _truth_suffix(manifest: Manifest) -> str:
    return ".mat" if manifest.kind == "w300lp-mat" else ".pts"


def _folder_of_part(manifest: Manifest, data: Path, part: BenchmarkPart) -> Path | None:
    """The first folder that holds a picture of the part: sets that share file names are never mixed."""
    candidates = (data / home / folder for home in manifest.homes for folder in part.folders)
    names = set(part.image_names)
    for folder in candidates:
        if folder.is_dir() and any(path.name in names for path in folder.iterdir()):
            return folder
    return None


def _read_pts_face(name: str, group: str, image: Path, truth: Path) -> BenchmarkFace:
    landmarks2d = read_pts(truth)
    return BenchmarkFace(
        name=name, group=group, image=decode_image(read_bytes(image), str(image)), landmarks2d=landmarks2d
    )


def _read_w300lp_face(name: str, _part: str, image: Path, truth: Path) -> BenchmarkFace:
    file = read_coefficient_file(truth)
    if file.landmarks3d is None:
        raise InputFileError(f"{truth}: expected the landmarks pt3d_68, found none; is this a file of AFLW2000-3D?")
    head = file.pose.head
    yaw_deg = wrap_angle_deg(head.yaw_deg)
    return BenchmarkFace(
        name=name,
        group=yaw_bin(yaw_deg),
        image=decode_image(read_bytes(image), str(image)),
        landmarks2d=file.landmarks3d[:, :2],
        yaw_deg=yaw_deg,
        has_unusual_angle=max(abs(head.pitch_deg), abs(head.yaw_deg), abs(head.roll_deg)) > USUAL_ANGLE_DEG,
    )


def _find_shards(manifest: Manifest, data: Path, model: MorphableModel) -> BenchmarkFiles:
    folders = [data / home for home in manifest.homes if any((data / home).glob("shard-*.h5"))]
    items: list[BenchmarkItem] = []
    unreadable: list[Unreadable] = []
    for path in shard_paths(folders[0]) if folders else []:
        try:
            with ShardReader(path) as reader:
                _check_model(path, reader, model)
                sample_ids = list(reader.sample_ids)
        except InputFileError as error:
            unreadable.append(Unreadable(path.name, str(error)))
            continue
        _check_samples(path, sample_ids, manifest)
        items += [
            BenchmarkItem(sample_id, partial(_read_shard_face, path, index))
            for index, sample_id in enumerate(sample_ids)
        ]
    there = {item.name for item in items}
    missing = tuple(sample_id for sample_id in manifest.sample_ids if sample_id not in there)
    return BenchmarkFiles(tuple(items), missing, tuple(unreadable))


def _check_samples(path: Path, sample_ids: list[str], manifest: Manifest) -> None:
    """Refuses samples that the split does not consist of: a network may have been trained on them."""
    expected = manifest.sample_ids
    foreign = sorted(set(sample_ids) - set(expected))
    if foreign:
        raise UsageError(
            f"{path}: expected the samples {expected[0]} to {expected[-1]} of {manifest.split}, found {foreign[0]}. "
            f"{manifest.how_to_get_it}"
        )


def _check_model(path: Path, reader: ShardReader, model: MorphableModel) -> None:
    if reader.header.model_sha256 != model.sha256:
        raise ModelMismatchError(
            f"{path}: shard of the model {reader.header.model_name} ({reader.header.model_sha256[:12]}), evaluation "
            f"with {model.name} ({model.sha256[:12]}); pass --model of the shard, or render shards of this model"
        )


def _read_shard_face(path: Path, index: int) -> BenchmarkFace:
    with ShardReader(path) as reader:
        triplet, image = reader.triplet(index), reader.image(index)
    yaw_deg = head_pose(triplet.camera).yaw_deg
    return BenchmarkFace(
        name=triplet.sample_id,
        group=yaw_bin(yaw_deg),
        image=image,
        landmarks2d=triplet.landmarks2d.astype(np.float64),
        yaw_deg=yaw_deg,
        maps=triplet.maps,
    )
