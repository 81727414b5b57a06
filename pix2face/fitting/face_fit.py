"""From the maps of one picture to camera, coefficients, mesh and landmarks."""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import final

import numpy as np
from jaxtyping import Float, Float32, Float64
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.fitting.picture_measurement import CameraKind as CameraKind
from pix2face.fitting.picture_measurement import Constraints, measure_picture
from pix2face.fitting.prepared_model import vertex_basis
from pix2face.geometry.camera import Camera
from pix2face.geometry.crops import Crop
from pix2face.geometry.landmarks import IBUG68
from pix2face.geometry.maps import FaceMaps
from pix2face.models.morphable_model import MorphableModel


@final
@dataclass(frozen=True, eq=False)
class FaceFit:
    """A face found in a picture; pixels are those of the maps, or of the image after ``in_image``.

    Attributes:
        camera: From the model frame to the picture.
        identity: Coefficients in standard deviations.
        expression: Coefficients in standard deviations.
        model: What the coefficients are of.
        landmarks2d: Projections of the landmark vertices, seen or hidden, pixels (x, y), centres at +0.5.
        landmarks3d: The landmark vertices, mm, model frame.
    """

    camera: Camera
    identity: Float64[ndarray, " k"]
    expression: Float64[ndarray, " e"]
    model: MorphableModel
    landmarks2d: Float64[ndarray, "m 2"]
    landmarks3d: Float64[ndarray, "m 3"]

    @cached_property
    def vertices(self) -> Float32[ndarray, "v 3"]:
        """The mesh of these coefficients, mm, model frame: computed when asked for."""
        return self.model.vertices(self.identity[None], self.expression[None])[0]

    def in_image(self, crop: Crop) -> "FaceFit":
        """The fit in the pixels of the image that the maps' crop was taken from."""
        camera = self.camera.transformed(crop.image_from_crop)
        return replace(self, camera=camera, landmarks2d=crop.to_image(self.landmarks2d))


def fit_face(
    maps: FaceMaps,
    model: MorphableModel,
    *,
    camera_kind: CameraKind = "weak-perspective",
    regularisation: float | None = None,
    principal_point_px: Float[ndarray, "2"] | None = None,
    scheme: str = IBUG68,
    reprojection_rounds: int = 0,
    n_vertices: int | None = None,
    constraints: Constraints = "vertices",
    silhouette: bool = False,
) -> FaceFit:
    """Fits camera and coefficients to the maps of one picture.

    Args:
        maps: PNCC, offset and mask; where they know which part of it is seen, the camera goes by that.
        model: The model that the maps are of.
        camera_kind: "affine" (Eq. 1), "weak-perspective" (the default: predicted maps of profiles tilt and stretch an
            unconstrained affine camera), "pinhole", or "auto": a pinhole where ``camera_choice`` finds it warranted,
            else weak perspective. All are robust against outliers.
        regularisation: Tikhonov's lambda in mm^2; None estimates it from the residuals (docs/explanation/fitting.md).
        principal_point_px: Pinhole and auto: where the optical axis meets the maps, None is their centre. It is not the
            centre where the maps are those of a crop off the image's centre.
        scheme: Which landmarks of the model.
        reprojection_rounds: How often the camera is fitted again to the fitted mesh, and the coefficients to where its
            vertices were found; 0 is the paper's way. With the silhouette at least once.
        n_vertices: How many vertices of the face to look for, evenly spread (docs/explanation/fitting.md: time against
            error). None are 1,200 where lambda is given as that of predicted maps (0.5 mm^2 and more), else 2,500.
        constraints: "vertices" as in the paper, or "surface": pixels inside the triangles of the mean face. On exact
            maps ten times as accurate, and ten times as slow; of noisy maps hardly a pixel lies on the surface.
        silhouette: Hold camera and mesh to the mask (``silhouette.py``): better on predicted maps, where PNCC alone
            tells the turn of a head badly. Of weak-perspective cameras and with constraints of vertices; others are
            not changed.

    Raises:
        DegenerateGeometryError: Fewer than 50 valid pixels, values that are not finite, or none of the vertices found.
        UsageError: The model has no such landmarks, or there is no such kind of camera.

    Source: Crispell and Bazik 2017, Sections 3.4 and 4.
    """
    check_scheme(model, scheme)
    measured = measure_picture(
        maps,
        model,
        camera_kind=camera_kind,
        regularisation=regularisation,
        principal_point_px=principal_point_px,
        reprojection_rounds=reprojection_rounds,
        n_vertices=n_vertices,
        constraints=constraints,
        silhouette=silhouette,
    )
    coefficients = measured.system.solve(measured.regularisation)
    identity, expression = coefficients[: model.n_identity], coefficients[model.n_identity :]
    return face_of_coefficients(model, measured.camera, identity, expression, scheme)


def face_of_coefficients(
    model: MorphableModel,
    camera: Camera,
    identity: Float64[ndarray, " k"],
    expression: Float64[ndarray, " e"],
    scheme: str = IBUG68,
) -> FaceFit:
    """Puts a face together from its camera and coefficients.

    Raises:
        UsageError: The model has no such landmarks.
    """
    check_scheme(model, scheme)
    mean, basis = _landmark_basis(model, scheme)
    landmarks3d = np.asarray(mean + basis @ np.concatenate([identity, expression]), dtype=np.float64)
    return FaceFit(camera, identity, expression, model, camera.project(landmarks3d), landmarks3d)


def check_scheme(model: MorphableModel, scheme: str) -> None:
    """Refuses landmarks that a model does not have.

    Raises:
        UsageError: See above.
    """
    if scheme not in model.landmarks:
        raise UsageError(f"expected landmarks {scheme!r} in the model {model.name!r}, found {sorted(model.landmarks)}")


@lru_cache(maxsize=4)
def _landmark_basis(model: MorphableModel, scheme: str) -> tuple[Float64[ndarray, "m 3"], Float64[ndarray, "m 3 c"]]:
    vertices = model.landmarks[scheme]
    return model.mean[vertices].astype(np.float64), vertex_basis(model, vertices).astype(np.float64)
