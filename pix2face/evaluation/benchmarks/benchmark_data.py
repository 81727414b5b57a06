"""The faces of a benchmark: what was found of them, what is missing, and what each is once it is read."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import Float, Float64, UInt8
from numpy import ndarray

from pix2face.errors import InputFileError
from pix2face.files.images import decode_image, read_bytes
from pix2face.geometry.camera import HeadPose
from pix2face.geometry.maps import FaceMaps

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
        landmarks2d: True landmarks, pixels.
        read_image: Reads the picture, RGB; raises InputFileError where it is damaged.
        image: The picture, once it is read.
        clip: The clip that it is a frame of, or None.
        yaw_deg: Yaw of the head, wrapped to ±180, where the truth knows it.
        has_unusual_angle: Whether one of pitch, yaw, roll is beyond ±99° as stored.
        pose: True pose of the head, where the truth knows it and can be trusted.
        landmarks3d: True landmarks in space, in the unit of the data, where the truth knows them.
        maps: True maps, where the truth knows them.
        identity: True coefficients in standard deviations, where the truth knows them.
        expression: The same.
    """

    name: str
    group: str
    landmarks2d: Float64[ndarray, "68 2"]
    read_image: Callable[[], UInt8[ndarray, "h w 3"]]
    image: UInt8[ndarray, "h w 3"] | None = None
    clip: str | None = None
    yaw_deg: float | None = None
    has_unusual_angle: bool = False
    pose: HeadPose | None = None
    landmarks3d: Float64[ndarray, "68 3"] | None = None
    maps: FaceMaps | None = None
    identity: Float[ndarray, " k"] | None = None
    expression: Float[ndarray, " e"] | None = None

    def with_image(self) -> "BenchmarkFace":
        """The face with its picture.

        Raises:
            InputFileError: The picture is damaged.
        """
        return self if self.image is not None else replace(self, image=self.read_image())


@final
@dataclass(frozen=True)
class BenchmarkItem:
    """A face that is complete on disk and not yet read.

    Attributes:
        name: What lists call it.
        load: Reads the truth; raises InputFileError where its files are damaged.
        attributes: What a render was drawn from; empty for photographs.
    """

    name: str
    load: Callable[[], BenchmarkFace]
    attributes: Mapping[str, str | float] = field(default_factory=dict)


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
        absent_names: Names of all faces of the benchmark that are not among the items, without remarks.
        frame_names: For each clip whose frames are pictures their names in order; frames of a video count from 1.
    """

    items: tuple[BenchmarkItem, ...]
    missing: tuple[str, ...]
    unreadable: tuple[Unreadable, ...] = ()
    absent_names: tuple[str, ...] = ()
    frame_names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def yaw_bin(yaw_deg: float) -> str:
    """The column of the table for a yaw angle (wrapped)."""
    return YAW_BINS[int(np.searchsorted(YAW_EDGES_DEG, abs(yaw_deg), side="left"))]


def wrap_angle_deg(angle_deg: float) -> float:
    """An angle brought to [-180, 180)."""
    return (angle_deg + 180) % 360 - 180


def picture_reader(path: Path) -> Callable[[], UInt8[ndarray, "h w 3"]]:
    """What reads a picture file when it is wanted."""

    def read() -> UInt8[ndarray, "h w 3"]:
        if not path.is_file():
            raise InputFileError(f"expected a picture at {path}, found none")
        return decode_image(read_bytes(path), str(path))

    return read
