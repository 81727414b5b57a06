"""A felt hat that fits every head, and where it begins for the hair below."""

import numpy as np

from datagen.appearance.hair.bound_meshes import bound_mesh, check_model
from datagen.appearance.hair.shape import CrownPlane
from datagen.appearance.scene import Material, PosedHead, SceneMesh

FEDORA_CROWN = CrownPlane((0.0, 79.0, 0.0), (0.0, 0.9998, -0.02))
# Tilted farther, it cuts into the head or floats.
LARGEST_TILT_DEG = 6.0
# The band lies upon the skin as it was modelled; hair takes this much room in addition.
ROOM = 1.035
AXIS_MM = np.array([0.0, 79.0, 5.0], dtype=np.float32)


def fedora_mesh(head: PosedHead, colour: tuple[float, float, float], tilt_deg: float = 0.0) -> SceneMesh:
    """The hat on a head; with ``FEDORA_CROWN`` its hair is kept below.

    Args:
        head: Whose it is; the hat follows it without its expression.
        colour: Linear, of the felt.
        tilt_deg: Forward, over the brows; within ``LARGEST_TILT_DEG`` both ways.

    Raises:
        InputFileError: The head is not of the built-in model.
    """
    check_model(head.model)
    mesh = bound_mesh("fedora")
    angle = np.deg2rad(tilt_deg)
    turn = np.array([[1, 0, 0], [0, np.cos(angle), -np.sin(angle)], [0, np.sin(angle), np.cos(angle)]])
    points = (mesh.mean - AXIS_MM) * np.float32(ROOM) @ turn.T.astype(np.float32) + AXIS_MM
    points += mesh.displacements(head.neutral, head.model.mean)
    return SceneMesh(
        name="headwear/fedora",
        label="headwear",
        vertices=points[mesh.point_of_vertex],
        triangles=mesh.triangles,
        uv=mesh.uv,
        normals=np.ascontiguousarray(mesh.normals[mesh.point_of_vertex]),
        material=Material(kind="object", texture="hair_fedora", colour=colour, roughness=0.9),
    )
