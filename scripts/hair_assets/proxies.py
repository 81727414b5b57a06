"""Reads MakeHuman's proxies (hair, brows, lashes, hats) from the npm package, in the frame of the built-in model."""

import json
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy import ndarray

from pix2face.models.model_file import read_stored_model
from pix2face.models.subdivision import catmull_clark
from scripts.build_builtin_model import MM_PER_UNIT
from scripts.builtin_model.wheel import AnnyWheel

PROXIES = Path("public/data/proxies")
# A quad with a material and texture coordinates in the old JSON format of three.js, the only kind in these files.
QUAD_WITH_UV, NUMBERS_OF_QUAD = 11, 10


@dataclass(frozen=True)
class BaseHead:
    """MakeHuman's unmodified head, aligned with the built-in model's mean."""

    base: ndarray  # all vertices of the base mesh, including body and helpers, mm, the built-in model's frame
    head: ndarray  # vertices of the built-in model on this head, after one refinement
    triangles: ndarray  # triangles of the refined mesh
    regions: ndarray  # name of the region of each triangle
    turn: ndarray  # rotation that was applied to the base mesh (its rows times this matrix)


@dataclass(frozen=True)
class Proxy:
    """A mesh on the unmodified head."""

    name: str  # name of its folder
    points: ndarray  # welded vertices, mm, the built-in model's frame
    quads: ndarray  # indices into `points`
    uv: ndarray  # texture coordinates, with the origin at the top left
    uv_quads: ndarray  # indices into `uv` for each corner of each quad
    texture: ndarray  # colour and alpha (h, w, 4), RGBA, 0 to 1


def read_base_head(wheel: AnnyWheel, model_file: Path) -> BaseHead:
    """Aligns the base mesh rigidly with the built-in model's mean."""
    stored, _ = read_stored_model(model_file)
    assert stored.source_vertices is not None
    base = wheel.mesh.vertices * MM_PER_UNIT
    ours, theirs = stored.mean.astype(np.float64), base[stored.source_vertices]
    u, _, vt = np.linalg.svd((theirs - theirs.mean(axis=0)).T @ (ours - ours.mean(axis=0)))
    turn = u @ vt
    base = (base - theirs.mean(axis=0)) @ turn + ours.mean(axis=0)
    step = catmull_clark(stored.polygons, len(stored.mean))
    quads = step.quads
    names = np.array(stored.region_names)[stored.polygon_regions[step.parents]]
    return BaseHead(
        base=base,
        head=step.operator @ base[stored.source_vertices],
        triangles=np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]),
        regions=np.concatenate([names, names]),
        turn=turn,
    )


def read_proxy(package: Path, folder: str, texture: str, base: BaseHead) -> Proxy:
    """Reads a proxy.

    Each vertex is the sum of an offset and a weighted mean of three base vertices. The stored ``vertices`` are not
    used, since those of some proxies are in another frame.

    Args:
        package: The unpacked npm package.
        folder: Folder in ``proxies``, such as ``hair/short01``.
        texture: File in its folder ``textures``.
        base: The head to which it is bound.

    Raises:
        SystemExit: A face is not a quad with texture coordinates.
    """
    place = package / PROXIES / folder
    document = json.loads(next(place.glob("*.json")).read_text(encoding="utf-8"))
    faces = np.array(document["faces"]).reshape(-1, NUMBERS_OF_QUAD)
    if (faces[:, 0] != QUAD_WITH_UV).any():
        raise SystemExit(f"{place}: expected quads with texture coordinates only, found others")
    weights, offsets = np.array(document["weights"]), np.array(document["offsets"])
    points = np.einsum("vk,vkc->vc", weights, base.base[np.array(document["ref_vIdxs"])])
    uv = np.array(document["uvs"][0]).reshape(-1, 2)
    return Proxy(
        name=place.name.lower(),
        points=points + offsets * MM_PER_UNIT @ base.turn,
        quads=faces[:, 1:5],
        uv=np.column_stack([uv[:, 0], 1 - uv[:, 1]]),
        uv_quads=faces[:, 6:10],
        texture=read_texture(place / "textures" / texture),
    )


def read_texture(path: Path) -> ndarray:
    """Reads a picture as RGBA, 0 to 1."""
    picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if picture is None or picture.shape[2:] != (4,):
        raise SystemExit(f"{path}: expected a picture with alpha, found {None if picture is None else picture.shape}")
    return picture[:, :, [2, 1, 0, 3]] / 255.0
