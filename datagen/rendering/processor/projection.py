"""Projects vertices in float64, rounds them to float32 once, and finds what they cover.

Loops index flat arrays: only then does the compiler know how far apart the numbers of a vertex are, and use vector
instructions.
"""

import numpy as np
from numpy import ndarray

from datagen.rendering.processor.compiling import compiled

f32, f64 = np.float32, np.float64


@compiled
def project_affine(vertices: ndarray, rows: ndarray, screen: ndarray) -> None:
    """Column, row and order of vertices, (v, 3) float32, by rows of a camera's matrix, into (v, 4) float32."""
    r00, r01, r02, r03 = rows[0]
    r10, r11, r12, r13 = rows[1]
    r20, r21, r22, r23 = rows[2]
    points, out = vertices.reshape(-1), screen.reshape(-1)
    for i in range(len(vertices)):
        x, y, z = f64(points[3 * i]), f64(points[3 * i + 1]), f64(points[3 * i + 2])
        out[4 * i] = r00 * x + r01 * y + r02 * z + r03
        out[4 * i + 1] = r10 * x + r11 * y + r12 * z + r13
        out[4 * i + 2] = r20 * x + r21 * y + r22 * z + r23
        out[4 * i + 3] = 0


@compiled
def project_pinhole(vertices: ndarray, rows: ndarray, reference: float, screen: ndarray) -> None:
    """As ``project_affine``, divided by the distance; the order is reference - reference² / distance."""
    r00, r01, r02, r03 = rows[0]
    r10, r11, r12, r13 = rows[1]
    r20, r21, r22, r23 = rows[3]
    points, out = vertices.reshape(-1), screen.reshape(-1)
    for i in range(len(vertices)):
        x, y, z = f64(points[3 * i]), f64(points[3 * i + 1]), f64(points[3 * i + 2])
        distance = r20 * x + r21 * y + r22 * z + r23
        inverse = 1 / distance
        out[4 * i] = (r00 * x + r01 * y + r02 * z + r03) * inverse
        out[4 * i + 1] = (r10 * x + r11 * y + r12 * z + r13) * inverse
        out[4 * i + 2] = reference * (distance - reference) * inverse
        out[4 * i + 3] = 0


@compiled
def smallest_depth(vertices: ndarray, row: ndarray) -> float:
    """The least depth of vertices by the last row of a pinhole's matrix, mm; NaN if any is NaN."""
    smallest = np.inf
    for i in range(len(vertices)):
        depth = row[0] * f64(vertices[i, 0]) + row[1] * f64(vertices[i, 1]) + row[2] * f64(vertices[i, 2]) + row[3]
        if not depth >= smallest:
            smallest = depth
            if np.isnan(depth):
                break
    return smallest


@compiled
def largest_difference(vertices: ndarray, mean: ndarray) -> float:
    """The largest difference of a coordinate between finite vertices, (v, 3) float32, and the mean face, (v, 4)."""
    points, means, largest = vertices.reshape(-1), mean.reshape(-1), f32(0)
    for i in range(len(vertices)):
        for k in range(3):
            difference = abs(points[3 * i + k] - means[4 * i + k])
            largest = difference if difference > largest else largest
    return largest


@compiled
def extremes(screen: ndarray) -> ndarray:
    """Smallest and largest column, row and order of (v, 4) float32 seen as int32; NaN counts as beyond infinity."""
    found, numbers = np.empty((2, 3), np.int32), screen.reshape(-1)
    for k in range(3):
        low, high = np.int32(0x7FFFFFFF), np.int32(-0x80000000)
        for i in range(len(screen)):
            bits = numbers[4 * i + k]
            ordered = bits ^ ((bits >> np.int32(31)) & np.int32(0x7FFFFFFF))
            low, high = min(low, ordered), max(high, ordered)
        found[0, k], found[1, k] = low, high
    return found ^ ((found >> np.int32(31)) & np.int32(0x7FFFFFFF))
