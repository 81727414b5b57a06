"""Points and meshes as binary ``.ply``."""

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray


def encode_ply(
    points: Float[ndarray, "n 3"],
    colours: UInt8[ndarray, "n 3"] | None = None,
    triangles: Int[ndarray, "t 3"] | None = None,
) -> bytes:
    """Points, with their colours (RGB) and the triangles between them, if there are any, as a ``.ply`` file."""
    vertex_type: list[tuple[str, str, int]] = [("place", "<f4", 3)]
    lines = [f"element vertex {len(points)}", *(f"property float {axis}" for axis in "xyz")]
    if colours is not None:
        vertex_type.append(("colour", "u1", 4))
        lines += [f"property uchar {channel}" for channel in ("red", "green", "blue", "alpha")]
    vertices = np.empty(len(points), dtype=vertex_type)
    vertices["place"] = points
    if colours is not None:
        vertices["colour"][:, :3], vertices["colour"][:, 3] = colours, 255
    content = vertices.tobytes()
    if triangles is not None:
        lines += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
        faces = np.empty(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        faces["count"], faces["corners"] = 3, triangles
        content += faces.tobytes()
    head = ["ply", "format binary_little_endian 1.0", "comment pix2face", *lines, "end_header"]
    return "\n".join(head).encode() + b"\n" + content
