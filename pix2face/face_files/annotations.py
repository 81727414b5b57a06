"""Folders of photographs with 68 annotated points: ``.pts`` (iBUG), ``.mat`` with ``pt3d_68``, dlib's XML.

What differs between them is settled here: where pixels are counted from, which picture belongs to which points, which
points are missing, whether the points can belong to their picture, and whether the jaw points follow the outline in the
photograph (annotated by hand) or are fixed points of a surface (projected from a 3D model).
"""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import final
from xml.parsers import expat

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.errors import InputFileError, UsageError
from pix2face.face_files.point_checks import check_points
from pix2face.face_files.w300lp import check_picture_height, read_aflw21_landmarks, read_coefficient_file
from pix2face.files.images import IMAGE_SUFFIXES, read_orientation, read_size_px
from pix2face.files.opening import is_regular, read_regular, walk_files
from pix2face.geometry.landmarks import (
    IBUG68,
    IBUG68_2D,
    INNER51,
    INNER51_SCHEME,
    N_IBUG68,
    SCHEMES,
    mark_missing,
    read_pts,
)

# The lists of 300-W for dlib hold 7,764 faces in 23 MB.
LARGEST_XML_BYTES = 128 << 20
MOST_BOXES, LONGEST_PATH, LONGEST_SHOWN = 500_000, 4096, 80
AFLW21_SCHEME = "aflw21"
IN_MAT_FILES, IN_LISTS = (IBUG68, INNER51_SCHEME, AFLW21_SCHEME), (IBUG68, IBUG68_2D, INNER51_SCHEME)
# 300-VW keeps points and frames in sister folders.
SISTER_FOLDERS = {"annot": "imgs"}


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class AnnotatedFace:
    """An annotated face."""

    image_path: Path
    # Pixels of the stored picture (x right, y down, centres at +0.5); NaN where a point is missing. There are 68 unless
    # another scheme was asked for.
    landmarks2d: Float64[ndarray, "m 2"]
    depths_px: Float64[ndarray, " m"] | None = None  # larger is farther, up to a constant; None where unknown
    follows_outline: bool = True  # jaw points lie on the outline of the face, not at fixed points of the skin


@final
@dataclass(frozen=True)
class Annotation:
    """A face that was found in a folder. ``load`` reads it and raises InputFileError for damaged or missing files."""

    name: str  # unique in the folder
    load: Callable[[], AnnotatedFace]
    path: Path  # the file that its points are in
    image_path: Path | None = None  # its picture as the file names it; None where it is the one beside the file


def find_annotations(folder: Path, scheme: str = IBUG68) -> list[Annotation]:
    """Finds all annotated faces in a folder and its subfolders, in the order of their names.

    Links to folders are not followed. The scheme is one of ``landmarks.SCHEMES``; the 51 inner points are also taken
    out of 68.

    Raises:
        UsageError: There is no such folder, or nothing in it.
    """
    if not folder.is_dir():
        raise UsageError(f"{folder}: expected a folder of annotated photographs, found none there")
    found = sorted(_annotations(folder, scheme), key=lambda annotation: annotation.name)
    if not found:
        raise UsageError(
            f"{folder}: expected photographs with {SCHEMES[scheme]} points each (.pts beside the picture, .mat with "
            "pt3d_68, or dlib's .xml), found none"
        )
    return [
        replace(annotation, name=name, load=partial(_load_checked, annotation))
        for name, annotation in zip(_unique(found), found, strict=True)
    ]


def read_dlib_xml(path: Path) -> list[tuple[str, Float64[ndarray, "_ 2"] | InputFileError]]:
    """Reads the faces of a list in dlib's XML.

    Each box comes with its picture as the file names it, and its points in the project's pixels, in the order of their
    names; or, where it is no face of 68 points, what is wrong with it. Boxes to be ignored are left out.

    Raises:
        InputFileError: The file cannot be read, is no such list, or declares entities (which could expand without
            bound).
    """
    faces = _FacesOfXml(path)
    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = faces.start, faces.end
    parser.EntityDeclHandler = faces.refuse_entity
    content = read_regular(path, "a list of faces in dlib's XML", LARGEST_XML_BYTES)
    try:
        # At once: parts of a long attribute would be looked through again with each part that is added.
        parser.Parse(content, True)
    except (expat.ExpatError, ValueError, LookupError, TypeError) as error:  # the last two: of the encoding
        raise InputFileError(
            f"{path}: expected a list of faces in dlib's XML, found something else ({type(error).__name__}: {error})"
        ) from error
    return faces.found


def picture_beside(path: Path) -> Path:
    """Finds the picture of an annotation: a file of the same name, beside it or in its sister folder.

    Raises:
        InputFileError: There is none.
    """
    folders = [path.parent]
    if path.parent.name in SISTER_FOLDERS:
        folders.append(path.parent.with_name(SISTER_FOLDERS[path.parent.name]))
    for folder in folders:
        for suffix in IMAGE_SUFFIXES:
            for candidate in (folder / f"{path.stem}{suffix}", folder / f"{path.stem}{suffix.upper()}"):
                if is_regular(candidate):
                    return candidate
    raise InputFileError(f"{path}: expected its picture {path.with_suffix('.jpg').name} beside it, found none")


def _annotations(folder: Path, scheme: str) -> Iterator[Annotation]:
    for path in walk_files(folder, (".pts", ".mat", ".xml")):
        stem, suffix = path.relative_to(folder).with_suffix("").as_posix(), path.suffix.lower()
        if suffix == ".pts":
            yield Annotation(stem, partial(_load_pts, path, scheme), path)
        elif suffix == ".mat" and not path.name.lower().endswith("_pts.mat") and scheme in IN_MAT_FILES:
            yield Annotation(stem, partial(_load_mat, path, scheme), path)
        elif suffix == ".xml" and scheme in IN_LISTS:
            yield from _annotations_of_xml(path, folder, scheme)


def _annotations_of_xml(path: Path, folder: Path, scheme: str) -> Iterator[Annotation]:
    try:
        faces = read_dlib_xml(path)
    except InputFileError as error:
        yield Annotation(path.relative_to(folder).as_posix(), partial(_load_box, path, path, error, scheme), path)
        return
    numbers: dict[str, int] = {}
    for image_name, points in faces:
        number = numbers[image_name] = numbers.get(image_name, -1) + 1
        image_path = path.parent / image_name
        stem = Path(os.path.normpath(image_path)).with_suffix("")
        name = stem.relative_to(folder).as_posix() if stem.is_relative_to(folder) else stem.name
        yield Annotation(f"{name}/face{number}", partial(_load_box, path, image_path, points, scheme), path, image_path)


def _unique(annotations: list[Annotation]) -> list[str]:
    """Names, with a number behind those that occur again (the same picture in two lists)."""
    seen: dict[str, int] = {}
    names = []
    for annotation in annotations:
        seen[annotation.name] = count = seen.get(annotation.name, 0) + 1
        names.append(annotation.name if count == 1 else f"{annotation.name}#{count}")
    return names


def _load_checked(annotation: Annotation) -> AnnotatedFace:
    """Loads a face whose points can be those of its picture."""
    face = annotation.load()
    size_px = read_size_px(face.image_path)
    inside = check_points(face.landmarks2d, size_px, read_orientation(face.image_path), annotation.path)
    if not face.follows_outline:  # points that a camera projected have their place outside of the picture, too
        return face
    return replace(face, landmarks2d=np.where(inside[:, None], face.landmarks2d, np.nan))


def _load_pts(path: Path, scheme: str) -> AnnotatedFace:
    try:
        landmarks2d = read_pts(path, SCHEMES[scheme])
    except InputFileError:
        if scheme != INNER51_SCHEME:
            raise
        landmarks2d = read_pts(path)[list(INNER51)]
    return AnnotatedFace(landmarks2d=landmarks2d, image_path=picture_beside(path))


def _load_mat(path: Path, scheme: str) -> AnnotatedFace:
    if scheme == AFLW21_SCHEME:
        return AnnotatedFace(image_path=picture_beside(path), landmarks2d=read_aflw21_landmarks(path))
    file, image_path = read_coefficient_file(path), picture_beside(path)
    check_picture_height(file, read_size_px(image_path)[0])
    if file.landmarks3d is None:
        raise InputFileError(
            f"{path}: expected pt3d_68 (AFLW2000-3D), found none; for files of 300W-LP use `datagen coeffs convert`"
        )
    landmarks3d = file.landmarks3d if scheme == IBUG68 else file.landmarks3d[list(INNER51)]
    return AnnotatedFace(
        image_path=image_path,
        landmarks2d=landmarks3d[:, :2].copy(),
        depths_px=landmarks3d[:, 2].copy(),
        follows_outline=False,
    )


def _load_box(path: Path, image_path: Path, points: ndarray | InputFileError, scheme: str) -> AnnotatedFace:
    if isinstance(points, InputFileError):
        raise points
    if not is_regular(image_path):
        raise InputFileError(f"{path}: expected the picture {image_path}, found none")
    return AnnotatedFace(
        image_path=image_path, landmarks2d=points[list(INNER51)] if scheme == INNER51_SCHEME else points
    )


class _FacesOfXml:
    """Collects the faces while the XML is parsed."""

    def __init__(self, path: Path) -> None:
        self.found: list[tuple[str, Float64[ndarray, "_ 2"] | InputFileError]] = []
        self._path = path
        self._depth = 0
        self._image = ""
        self._parts: dict[str, tuple[float, float]] | None = None

    def start(self, name: str, attributes: dict[str, str]) -> None:
        if not self._depth and name != "dataset":
            raise ValueError(f"it begins with <{name}>, not with <dataset>")
        self._depth += 1
        if name == "image":
            self._image = attributes["file"]
            if len(self._image) > LONGEST_PATH:  # no file has such a name; the end of it does not help either
                self._image = f"{self._image[:LONGEST_SHOWN]}..."
        elif name == "box" and attributes.get("ignore", "0") != "1":
            self._parts = {}
        elif name == "part" and self._parts is not None:
            self._parts[attributes["name"]] = float(attributes["x"]), float(attributes["y"])

    def end(self, name: str) -> None:
        self._depth -= 1
        if name == "box" and self._parts is not None:
            if len(self.found) >= MOST_BOXES:
                raise ValueError(f"it has more than {MOST_BOXES} boxes")
            self.found.append((self._image, self._points(self._parts)))
            self._parts = None

    def refuse_entity(self, name: str, *_: object) -> None:
        raise ValueError(f"it declares the entity {name!r}, which such a list does not need")

    def _points(self, parts: dict[str, tuple[float, float]]) -> Float64[ndarray, "_ 2"] | InputFileError:
        unknown = [name for name in parts if not (name.isdecimal() and int(name) < N_IBUG68)]
        if unknown or len(parts) < N_IBUG68 // 2:
            found = f"{len(parts)} parts" + (f", one named {unknown[0][:LONGEST_SHOWN]!r}" if unknown else "")
            return InputFileError(
                f"{self._path}: expected {N_IBUG68} parts, named 00 to 67, in a box of {self._image}, found {found}"
            )
        points = np.full((N_IBUG68, 2), np.nan)
        for name, position in parts.items():
            points[int(name)] = position
        return mark_missing(points) + 0.5  # dlib counts pixels from 0, with integers at their centres
