"""The faces of a benchmark, before and after they are read, and those that are missing or unreadable."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float, Float64, UInt8
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.images import read_photograph
from pix2face.geometry.camera import HeadPose
from pix2face.geometry.maps import FaceMaps

YAW_BINS = ("|yaw| <= 30°", "30° < |yaw| <= 60°", "|yaw| > 60°")
YAW_EDGES_DEG = (30.0, 60.0)


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class BenchmarkFace:
    """A picture and its truth. What the truth does not state is None."""

    name: str  # its name in lists
    group: str  # the column of the table in which it counts
    landmarks2d: Float64[ndarray, "68 2"]  # true landmarks, pixels
    read_image: Callable[[], UInt8[ndarray, "h w 3"]]  # reads the picture (RGB), or raises InputFileError
    image: UInt8[ndarray, "h w 3"] | None = None  # the picture, once it has been read
    clip: str | None = None  # the clip of a frame
    yaw_deg: float | None = None  # true yaw, wrapped to ±180
    has_unusual_angle: bool = False  # whether the stored pitch, yaw or roll is beyond ±99°
    pose: HeadPose | None = None  # true pose of the head; None also where it cannot be trusted
    landmarks3d: Float64[ndarray, "68 3"] | None = None  # true 3D landmarks in the unit of the data
    maps: FaceMaps | None = None  # true maps
    identity: Float[ndarray, " k"] | None = None  # true coefficients, standard deviations
    expression: Float[ndarray, " e"] | None = None  # likewise

    def with_image(self) -> "BenchmarkFace":
        """The face with its picture.

        Raises:
            InputFileError: The picture is damaged.
        """
        return self if self.image is not None else replace(self, image=self.read_image())


@final
@dataclass(frozen=True)
class BenchmarkItem:
    """A face that is complete on disk and not yet read."""

    name: str  # its name in lists
    load: Callable[[], BenchmarkFace]  # reads the truth, or raises InputFileError
    attributes: Mapping[str, str | float] = field(default_factory=dict)  # those of a render; none for photographs


@final
@dataclass(frozen=True)
class Unreadable:
    """A face whose files are there but cannot be used."""

    name: str
    reason: str


@final
@dataclass(frozen=True)
class BenchmarkFiles:
    """The files of a split that were found."""

    items: tuple[BenchmarkItem, ...]  # complete faces
    missing: tuple[str, ...]  # names of the faces that are not there, each with what is missing
    unreadable: tuple[Unreadable, ...] = ()  # whole files that cannot be opened (damaged shards)
    absent_names: tuple[str, ...] = ()  # names of the faces that are not among the items, without remarks
    # For each clip whose frames are pictures: their names, in order. Frames of a video are numbered from 1.
    frame_names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def yaw_bin(yaw_deg: float) -> str:
    """The column of the table for a wrapped yaw angle."""
    return YAW_BINS[int(np.searchsorted(YAW_EDGES_DEG, abs(yaw_deg), side="left"))]


def wrap_angle_deg(angle_deg: float) -> float:
    """An angle brought to [-180, 180)."""
    return (angle_deg + 180) % 360 - 180


def complete(landmarks2d: Float64[ndarray, "68 2"], where: Path) -> Float64[ndarray, "68 2"]:
    """True points of which none is missing, since errors are means over all of them.

    Raises:
        InputFileError: Some are.
    """
    n_missing = int(np.isnan(landmarks2d).any(axis=1).sum())
    if n_missing:
        raise InputFileError(f"{where}: expected all of the {len(landmarks2d)} true points, found {n_missing} missing")
    return landmarks2d


def picture_reader(path: Path) -> Callable[[], UInt8[ndarray, "h w 3"]]:
    """A function that reads a picture file."""

    def read() -> UInt8[ndarray, "h w 3"]:
        if not path.is_file():
            raise InputFileError(f"expected a picture at {path}, found none")
        return read_photograph(path)

    return read
