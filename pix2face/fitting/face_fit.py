"""From the maps of one picture to camera, coefficients, mesh and landmarks."""

from dataclasses import dataclass, replace
from typing import Literal, final

import numpy as np
from jaxtyping import Float, Float32, Float64, Int
from numpy import ndarray

from pix2face.camera import Camera
from pix2face.crops import Crop
from pix2face.errors import DegenerateGeometryError, UsageError
from pix2face.face_maps import FaceMaps
from pix2face.fitting.camera_fit import fit_affine_camera, fit_weak_perspective_camera
from pix2face.fitting.coefficient_fit import fit_coefficients
from pix2face.fitting.localise import check_finite_pixels, localise_vertices
from pix2face.fitting.pinhole_fit import fit_pinhole_camera
from pix2face.landmarks import IBUG68
from pix2face.morphable_model import MorphableModel

CameraKind = Literal["affine", "weak-perspective", "pinhole"]

# Section 3.4.1: "only a small subset of the correspondences" is needed for the camera. Of vertices, as many tell some
# hundred coefficients as well as all of them do, at a fraction of the time.
CAMERA_PIXELS = 2000
COEFFICIENT_VERTICES = 2500

# Fewer valid pixels are noise at the edge of a picture without a face.
LEAST_PIXELS = 50


@final
@dataclass(frozen=True, eq=False)
class FaceFit:
    """A face found in a picture; pixels are those of the maps, or of the image after ``in_image``.

    Attributes:
        camera: From the model frame to the picture.
        identity: Coefficients in standard deviations.
        expression: Coefficients in standard deviations.
        vertices: The mesh of these coefficients, mm, model frame.
        landmarks2d: Projections of the landmark vertices, seen or hidden, pixels (x, y), centres at +0.5.
        landmarks3d: The landmark vertices, mm, model frame.
    """

    camera: Camera
    identity: Float64[ndarray, " k"]
    expression: Float64[ndarray, " e"]
    vertices: Float32[ndarray, "v 3"]
    landmarks2d: Float64[ndarray, "m 2"]
    landmarks3d: Float64[ndarray, "m 3"]

    def in_image(self, crop: Crop) -> "FaceFit":
        """The fit in the pixels of the image that the maps' crop was taken from."""
        camera = self.camera.transformed(crop.image_from_crop)
        return replace(self, camera=camera, landmarks2d=crop.to_image(self.landmarks2d))


def fit_face(
    maps: FaceMaps,
    model: MorphableModel,
    *,
    camera_kind: CameraKind = "weak-perspective",
    regularisation: float,
    principal_point_px: Float[ndarray, "2"] | None = None,
    scheme: str = IBUG68,
) -> FaceFit:
    """Fits camera and coefficients to the maps of one picture.

    Args:
        maps: PNCC, offset and mask.
        model: The model that the maps are of.
        camera_kind: "affine" (Eq. 1), "weak-perspective" (the default: predicted maps of profiles tilt and stretch an
            unconstrained affine camera; robust against outliers), or "pinhole".
        regularisation: Tikhonov's lambda in mm^2; see ``coefficient_fit``.
        principal_point_px: Pinhole only: where the optical axis meets the maps, None is their centre. It is not the
            centre where the maps are those of a crop off the image's centre.
        scheme: Which landmarks of the model.

    Raises:
        DegenerateGeometryError: Fewer than 50 valid pixels, values that are not finite, or none of the vertices found.
        UsageError: The model has no such landmarks, or there is no such kind of camera.

    Source: Crispell and Bazik 2017, Sections 3.4 and 4.
    """
    if scheme not in model.landmarks:
        raise UsageError(f"expected landmarks {scheme!r} in the model {model.name!r}, found {sorted(model.landmarks)}")
    points3d, points2d = correspondences(maps, CAMERA_PIXELS)
    if principal_point_px is None:
        principal_point_px = np.array([maps.mask.shape[1], maps.mask.shape[0]]) / 2
    camera = fit_camera(points3d, points2d, camera_kind, principal_point_px)
    found = localise_vertices(maps, model.mean, spread_vertices(model, COEFFICIENT_VERTICES))
    identity, expression = fit_coefficients(model, found.vertex_indices, found.offsets, regularisation)
    vertices = model.vertices(identity[None], expression[None])[0]
    landmarks3d = vertices[model.landmarks[scheme]].astype(np.float64)
    return FaceFit(camera, identity, expression, vertices, camera.project(landmarks3d), landmarks3d)


def correspondences(maps: FaceMaps, at_most: int) -> tuple[Float64[ndarray, "n 3"], Float64[ndarray, "n 2"]]:
    """Points of the face (x_i = PNCC + offset, mm) and the centres of their pixels, evenly spread over the valid ones.

    Raises:
        DegenerateGeometryError: Fewer than 50 valid pixels, or values that are not finite.
    """
    rows, columns = np.nonzero(maps.mask)
    kept = evenly_spread(len(rows), at_most)
    points3d = maps.pncc[maps.mask].astype(np.float64) + maps.offset[maps.mask]
    check_finite_pixels(points3d)
    if len(rows) < LEAST_PIXELS:
        raise DegenerateGeometryError(
            f"expected at least {LEAST_PIXELS} valid pixels in the maps, found {len(rows)}: no face is in the crop"
        )
    return points3d[kept], np.column_stack([columns, rows])[kept] + 0.5


def fit_camera(
    points3d: Float[ndarray, "n 3"],
    points2d: Float[ndarray, "n 2"],
    camera_kind: CameraKind,
    principal_point_px: Float[ndarray, "2"],
) -> Camera:
    """Fits the chosen kind of camera.

    Raises:
        DegenerateGeometryError: The points do not determine it.
        UsageError: There is no such kind.
    """
    if camera_kind == "affine":
        return fit_affine_camera(points3d, points2d)
    if camera_kind == "weak-perspective":
        return fit_weak_perspective_camera(points3d, points2d, robust=True)
    if camera_kind == "pinhole":
        return fit_pinhole_camera(points3d, points2d, principal_point_px, fit_affine_camera(points3d, points2d))
    raise UsageError(f"expected a camera of affine, weak-perspective or pinhole, found {camera_kind!r}")


def spread_vertices(model: MorphableModel, at_most: int) -> Int[ndarray, " n"]:
    """Vertices of the face, evenly spread over its list of vertices."""
    face = np.flatnonzero(model.is_face_vertex)
    return face[evenly_spread(len(face), at_most)]


def evenly_spread(total: int, at_most: int) -> Int[ndarray, " n"]:
    """At most so many indices below a total, at even distances."""
    return np.unique(np.linspace(0, max(total - 1, 0), min(total, at_most)).astype(np.intp))
