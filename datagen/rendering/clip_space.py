"""A camera in OpenGL's clip space, for pictures, whose surfaces OpenGL interpolates (maps: ``screen_projection``)."""

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from pix2face.geometry.camera import Camera

# Vertices exactly on the near or far plane may be clipped by rounding: the planes stand off by this part of the range.
DEPTH_MARGIN = 1e-3


def clip_transform(camera: Camera, nearest: float, extent: float, height: int, width: int) -> Float64[ndarray, "4 4"]:
    """Brings a camera into clip space. Row 0 of the image becomes the first of the buffer.

    With that, v runs down the image and up OpenGL's window: of a camera of ``handedness`` 1, triangles that show their
    outside turn clockwise there.

    The third clip coordinate is ``a depth + b`` for both kinds of camera. With w = 1 that is linear in the depth, with
    w = depth it is linear in 1 / depth after the division by w: each is linear in the image, as the depth test wants.
    Depth is taken relative to the nearest point, because float32 must not see the difference of two large depths.

    ``nearest`` is the smallest depth that is drawn (a pinhole cuts off what is nearer), ``extent`` the largest minus
    the smallest depth, both in mm.
    """
    margin = DEPTH_MARGIN * max(extent, 1.0)
    depth_row = camera.matrix[2] - np.array([0, 0, 0, nearest])
    low, high = -margin, extent + margin  # the planes, relative
    if camera.is_affine:
        a, b = 2 / (high - low), -(high + low) / (high - low)
    else:
        low = max(low, -0.5 * nearest)
        a = (2 * nearest + high + low) / (high - low)  # z / w is -1 at the near plane and 1 at the far one
        b = -(nearest + low) - a * low
    return np.stack(
        [
            2 / width * camera.matrix[0] - camera.matrix[3],
            2 / height * camera.matrix[1] - camera.matrix[3],
            a * depth_row + np.array([0, 0, 0, b]),
            camera.matrix[3],
        ]
    )
