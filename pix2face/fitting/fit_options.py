"""How faces are fitted to maps: one set of options for programs, the Python interface, and validation in training."""

import math
from dataclasses import dataclass
from typing import Final, Literal, final, get_args

from pix2face.errors import UsageError

CameraKind = Literal["affine", "weak-perspective", "pinhole", "auto"]
Regularisation = float | Literal["estimate"]
LandmarkType = Literal["auto", "3d", "2d"]

# Exact maps: rounding to 1/128 mm and the mesh's kinks between pixels leave 0.01 mm.
EXACT_MAPS_REGULARISATION = 1e-4
# Predicted maps: landmarks hardly depend on it, and estimating it takes longer than all else
# (docs/explanation/fitting.md).
PREDICTED_MAPS_REGULARISATION = 20.0
MOST_REPROJECTION_ROUNDS = 100
# Cameras that can be held to the silhouette; of "auto" those that it finds to be weak-perspective.
HELD_CAMERAS = ("weak-perspective", "auto")


@final
@dataclass(frozen=True)
class FitOptions:
    """How camera, coefficients and landmarks of a face are found. The defaults are for maps that a network predicts.

    The penalty on coefficients is lambda |c|^2 with coefficients in standard deviations. If the errors of the
    constraints are independent, the best lambda is the variance (mm^2) of the error of one coordinate of one offset.
    Errors of a network are correlated over patches of the face: if n constraints share one error, the best lambda is n
    times the variance.

    Source: Crispell and Bazik 2017, Eq. 1 (affine camera) and Eq. 4 (regularisation).

    Attributes:
        camera: Camera of the fit. A pinhole has its principal point at the centre of the photograph; auto uses a
            pinhole if the face shows perspective, and weak-perspective otherwise.
        regularisation: Tikhonov weight of the coefficients, in mm^2; `estimate` computes it from the maps of each face,
            which takes longer.
        landmark_type: What the 68 landmarks in the picture are: 3d for fixed points of the skin, as in AFLW2000-3D, 2d
            for the points that people mark in photographs, as in 300-W, with the jaw on the visible outline. auto is
            the type of the benchmark for `evaluate`, and 3d for everything else.
        silhouette: Keep the fitted face inside its mask (the silhouette). For weak-perspective cameras only.
        correction: Let the network correct the fit, if it can. For fits with weak-perspective cameras that are held to
            the silhouette only: it learned from these.
        reprojection_rounds: How often the camera is fitted again to the fitted mesh, and then the coefficients to that
            camera.
    """

    camera: CameraKind = "weak-perspective"
    regularisation: Regularisation = PREDICTED_MAPS_REGULARISATION
    landmark_type: LandmarkType = "auto"
    silhouette: bool = True
    correction: bool = True
    reprojection_rounds: int = 0

    @property
    def is_held(self) -> bool:
        """Whether the fit is held to the silhouette."""
        return self.silhouette and self.camera in HELD_CAMERAS

    @property
    def is_corrected(self) -> bool:
        """Whether a network that can correct the fit does."""
        return self.correction and self.silhouette and self.camera == "weak-perspective"

    def check(self) -> None:
        """Refuses values that no fit can use.

        Raises:
            UsageError: A regularisation that is neither positive nor `estimate`, rounds out of range, or another type
                of landmarks.
        """
        if self.landmark_type not in get_args(LandmarkType):
            known = ", ".join(get_args(LandmarkType))
            raise UsageError(f"expected --landmark-type of {known}, found {self.landmark_type!r}")
        if self.regularisation != "estimate" and not 0 < self.regularisation < math.inf:
            raise UsageError(f"expected a positive --regularisation in mm^2, or estimate, found {self.regularisation}")
        if not 0 <= self.reprojection_rounds <= MOST_REPROJECTION_ROUNDS:
            raise UsageError(
                f"expected --reprojection-rounds from 0 to {MOST_REPROJECTION_ROUNDS}, found {self.reprojection_rounds}"
            )


# The one default: whatever is not told how to fit takes this very object.
DEFAULT_FIT: Final = FitOptions()
