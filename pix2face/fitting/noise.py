"""How noisy maps are: white noise from pixel to pixel, and what the fit must not follow (lambda) from its residuals."""

import cv2
import numpy as np
from jaxtyping import Float, Float64, Int
from numpy import ndarray
from scipy.linalg import solve_triangular

from pix2face.fitting.least_squares.linear_system import ImageSystem
from pix2face.geometry.maps import FaceMaps

# The median of the absolute value of a normal number, and the standard deviation of a second difference.
MEDIAN_OF_NORMAL = 0.6745
SIGMA_OF_SECOND_DIFFERENCE = 6**0.5

# Networks' maps are smooth (0.02 to 0.2 mm from pixel to pixel): they are left as they are.
WHITE_NOISE_IS_STRONG_MM = 0.4
# Width of the median filter where it is strong: 25 pixels reduce white noise to a quarter, and outliers vanish.
FILTER_PX = 5

FIRST_REGULARISATION = 10.0
# Rounding to 1/128 mm alone; and several millimetres over whole patches.
SMALLEST_REGULARISATION, LARGEST_REGULARISATION = 1e-4, 1e3
# The estimate is a fixed point that is approached from one side: twice each step (in the logarithm) converges as well,
# in half the rounds. It ends when lambda moves by less than this factor.
ROUNDS = 16
STEP = 2
HAS_SETTLED = 1.1


def white_noise_mm(maps: FaceMaps) -> float:
    """Standard deviation of what differs from pixel to pixel in one coordinate of the offsets, mm.

    The median of second differences along every eighth row: slopes drop out, and folds and outliers are few.
    """
    some, mask = maps.offset[::8], maps.mask[::8]
    difference = some[:, :-2] - 2 * some[:, 1:-1] + some[:, 2:]
    inside = mask[:, :-2] & mask[:, 1:-1] & mask[:, 2:]
    if not inside.any():
        return 0.0
    return float(np.median(np.abs(difference[inside]))) / (MEDIAN_OF_NORMAL * SIGMA_OF_SECOND_DIFFERENCE)


def without_white_noise(maps: FaceMaps) -> FaceMaps:
    """The maps, median-filtered where their white noise is strong; then without their outermost two pixels.

    Maps that are not finite come back as they are, for who reads them to refuse.
    """
    if not white_noise_mm(maps) > WHITE_NOISE_IS_STRONG_MM:
        return maps
    kernel = np.ones((FILTER_PX, FILTER_PX), np.uint8)
    eroded = cv2.erode(maps.mask.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0).astype(bool)
    pncc, offset = (
        np.asarray(cv2.medianBlur(np.ascontiguousarray(values), FILTER_PX) * eroded[:, :, None], dtype=np.float32)
        for values in (maps.pncc, maps.offset)
    )
    seen = None if maps.seen is None else maps.seen & eroded
    return FaceMaps(pncc, offset, eroded, seen, maps.in_photograph)


def estimated_regularisation(
    system: ImageSystem,
    basis: Float[ndarray, "n 3 c"],
    offsets: Float[ndarray, "n 3"],
    patches: Int[ndarray, " n"],
) -> float:
    """Estimates lambda (mm^2) from the residuals of one picture.

    lambda is the variance of the errors where they are independent, and n times the variance where n constraints share
    one error. Both are the number of constraints in a patch times the variance of the patch's mean error. The mean
    error of a patch is its mean residual, plus what the coefficients that were fitted may have followed: their
    posterior variance there. A fixed point is looked for, since the residuals depend on lambda.

    System, basis (mm per standard deviation), offsets (mm) and the numbers of patches are those of the found vertices.

    Source: Dempster, Laird and Rubin 1977 (the two steps of expectation-maximisation, for one variance).
    """
    counts, means = _patch_sums(basis.reshape(len(basis), -1), system.weights, patches)
    targets = _patch_sums(offsets, system.weights, patches)[1]
    patch_basis = means.reshape(len(counts), 3, -1)
    regularisation = FIRST_REGULARISATION
    for _ in range(ROUNDS):
        before = regularisation
        factor = system.factor(regularisation)
        residuals = patch_basis @ system.solve(regularisation) - targets
        spread = solve_triangular(factor[0], patch_basis.reshape(-1, means.shape[1] // 3).T, trans="T", lower=False)
        posterior = regularisation * (spread**2).sum(axis=0).reshape(len(counts), 3)
        variance = (residuals**2 + posterior).mean(axis=1)
        regularisation *= (float(counts @ variance / len(counts)) / before) ** STEP
        regularisation = min(max(regularisation, SMALLEST_REGULARISATION), LARGEST_REGULARISATION)
        if 1 / HAS_SETTLED < regularisation / before < HAS_SETTLED:
            break
    return regularisation


def _patch_sums(
    values: Float[ndarray, "n d"], weights: Float64[ndarray, " n"], patches: Int[ndarray, " n"]
) -> tuple[Float64[ndarray, " p"], Float64[ndarray, "p d"]]:
    """Sum of the weights of each patch that has any, and the weighted mean of the values there."""
    numbers, place = np.unique(patches, return_inverse=True)
    share = np.zeros((len(numbers), len(patches)))
    share[place, np.arange(len(patches))] = weights
    counts = share.sum(axis=1)
    kept = counts > 0
    return counts[kept], (share @ values)[kept] / counts[kept, None]
