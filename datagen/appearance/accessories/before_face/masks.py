"""Masks over mouth and nose: surgical, cloth or pointed masks, gaiters and veils."""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Float, Float32
from numpy import ndarray

from datagen.appearance.accessories.clothing.body import Body
from datagen.appearance.accessories.hats.headwear_meshes import cowl
from datagen.appearance.accessories.head_fit import bilinear, fit_skull, grid_outward, nearest_on_side
from datagen.appearance.accessories.materials import WHITE, cloth, cut_out, draw_cloth_colour, linear_colour
from datagen.appearance.scene import Colour, PosedHead, SceneMesh
from datagen.appearance.solids import Solid, joined, scene_mesh, sheet, tube
from datagen.random_streams import rounded

MASKS = ("surgical", "cloth", "pointed", "gaiter", "veil")
_CENTRE = (0.0, -38.0, 28.0)
_ROWS, _COLUMNS = 25, 33
_HALF_WIDTH_DEG, _TOP_DEG, _BOTTOM_DEG = 84.0, 44.0, -66.0
_EARS = ((76.0, 34.0, -2.0), (72.5, -14.0, -4.0))  # places behind the left ear, above and below


@final
@dataclass(frozen=True, kw_only=True)
class Mask:
    """A mask."""

    kind: str  # one of `MASKS`
    weave: str
    colour: Colour  # linear
    second: Colour  # linear colour of the pattern
    size: float  # 0 is small, 1 large
    is_below_nose: bool  # whether it is worn below the nose
    seed: int  # for the folds


def draw_mask(rng: np.random.Generator) -> Mask:
    """Draws a mask."""
    kind = str(rng.choice(MASKS, p=[0.42, 0.24, 0.16, 0.14, 0.04]))
    blue = linear_colour((0.50 + 0.2 * rng.uniform(), 0.72 + 0.1 * rng.uniform(), 0.85))
    colour = {"surgical": blue if rng.uniform() < 0.7 else WHITE, "pointed": WHITE}.get(kind, draw_cloth_colour(rng))
    weave = {"surgical": "pleats", "pointed": "jersey", "veil": "lace", "gaiter": "jersey"}.get(kind)
    return Mask(
        kind=kind,
        weave=weave or str(rng.choice(["jersey", "linen", "flowers", "dots", "plaid", "stripes_across"])),
        colour=colour,
        second=draw_cloth_colour(rng),
        size=rounded(rng.uniform()),
        is_below_nose=bool(rng.uniform() < 0.12) and kind != "veil",
        seed=int(rng.integers(2**31)),
    )


def mask_meshes(mask: Mask, head: PosedHead, body: Body) -> list[SceneMesh]:
    """Makes the meshes of a mask and its loops."""
    material = cloth(mask.weave, mask.colour, mask.second, 0.9)
    if mask.kind == "veil":
        lace = cut_out("lace", mask.colour, mask.colour, 0.9)
        return [scene_mesh("mask/veil", "mask", _veil(mask, head), lace, casts_shadow=False)]
    if mask.kind == "gaiter":
        return [scene_mesh("mask/gaiter", "mask", joined([_gaiter(mask, head), cowl(body, mask.seed, 1.0)]), material)]
    made, sides = _face_piece(mask, head)
    string = cloth("jersey", WHITE if mask.kind != "cloth" else mask.second)
    loops = joined([_loop(head, sides[side], side) for side in (1, -1)])
    return [
        scene_mesh(f"mask/{mask.kind}", "mask", made, material),
        scene_mesh("mask/loops", "mask", loops, string, casts_shadow=False),
    ]


def _face_piece(mask: Mask, head: PosedHead) -> tuple[Solid, dict[int, Float[ndarray, "2 3"]]]:
    """Makes the cloth over the face, and returns its corners on each side (1 is left), upper first."""
    points = _bridged(head)
    reach = 0.70 + 0.14 * mask.size
    columns = (np.linspace(-reach, reach, 25) + 1) / 2 * (_COLUMNS - 1)
    aside = np.abs(np.linspace(-1, 1, 25))
    top = (0.42 if mask.is_below_nose else 0.13) + (0.10 if mask.is_below_nose else 0.28) * aside**2
    bottom = 0.97 - 0.20 * aside**2
    rows = (top + np.linspace(0, 1, 19)[:, None] * (bottom - top)) * (_ROWS - 1)
    grid = bilinear(points, rows, np.broadcast_to(columns, rows.shape))
    share = np.linspace(0, 1, 19)[:, None]
    inner = np.sin(np.pi * share) * (1 - aside**2)
    outward = grid - _CENTRE
    outward /= np.linalg.norm(outward, axis=-1, keepdims=True)
    puff = {"surgical": 5.0, "cloth": 4.0, "pointed": 17.0}[mask.kind]
    crease = 1 - aside if mask.kind == "pointed" else 1 - aside**2
    above = 2.2 + puff * inner * (0.6 + 0.8 * mask.size) * crease
    grid = grid + above[..., None] * outward
    sides = {side: grid[[1, -2], 0 if side < 0 else -1].astype(np.float64) for side in (1, -1)}
    return sheet(grid, (1.0, 1.0) if mask.kind == "surgical" else (3.0, 2.5)), sides


def _loop(head: PosedHead, corners: Float[ndarray, "2 3"], side: int) -> Solid:
    """Makes the loop behind an ear."""
    ear = nearest_on_side(head.model, _EARS, side, ("skin", "scalp", "neck"))
    over, under = head.neutral[ear].astype(np.float64) + [side * 2.0, 0, 0]
    behind = 0.5 * (over + under) + [side * 3.5, 0, -17]
    middle = [0.5 * (corners[0] + over) + [side * 3.0, 0, 0], 0.5 * (corners[1] + under) + [side * 3.0, 0, 0]]
    return tube(np.stack([corners[0], middle[0], over, behind, under, middle[1], corners[1]]), 1.1, (0.3, 0.2, 1), 5)


def _bridged(head: PosedHead) -> Float32[ndarray, "r c 3"]:
    """Returns the lower face with hollows beside the nose and below the lips bridged, as stiff cloth does."""
    anchors = grid_outward(head.model, _CENTRE, (_TOP_DEG, _BOTTOM_DEG), _HALF_WIDTH_DEG, (_ROWS, _COLUMNS))
    points = anchors.at(head.vertices)
    ways = points - _CENTRE
    radii = np.linalg.norm(ways, axis=1).reshape(_ROWS, _COLUMNS).astype(np.float32)
    soft = radii
    for _ in range(3):
        soft = np.maximum(radii, cv2.GaussianBlur(soft, (0, 0), 2.2, borderType=cv2.BORDER_REPLICATE))
    ways = ways.reshape(_ROWS, _COLUMNS, 3) / radii[..., None]
    return np.asarray(_CENTRE + soft[..., None] * ways, dtype=np.float32)


def _gaiter(mask: Mask, head: PosedHead) -> Solid:
    """Makes a tube scarf around the head, pulled up over mouth or nose."""
    skull = fit_skull(head, with_expression=True)
    around = np.linspace(-np.pi, np.pi, 49)[None]
    top = np.deg2rad((-41 if mask.is_below_nose else -25) - 4 * mask.size + 3 * np.cos(around))
    share = np.linspace(0, 1, 10)[:, None]
    rise = top + share * (np.deg2rad(-73) - top)
    rng = np.random.default_rng(mask.seed)
    folds = sum(np.sin(k * around + rng.uniform(0, 6) + 7 * share) for k in (3, 6, 9)) / 3
    radii = skull.radius(rise, around)
    widest = cv2.dilate(np.concatenate([radii] * 3, axis=1), np.ones((3, 5)))
    soft = cv2.GaussianBlur(widest, (0, 0), 1.2)[:, 49:98]
    above = 4.5 + 1.5 * folds + np.maximum(soft - radii, 0) + 5 * mask.size * share
    return sheet(skull.at(rise, around, above), (12.0, 4.0), is_closed=True)


def _veil(mask: Mask, head: PosedHead) -> Solid:
    """Makes thin lace that hangs in front of the face."""
    skull = fit_skull(head)
    around = np.deg2rad(np.linspace(-105, 105, 31))[None]
    rise = np.deg2rad(np.linspace(38, -35 - 25 * mask.size, 12))[:, None]
    radii = skull.radius(rise, around)
    reach = np.maximum(radii + 14, 104 + 10 * np.cos(around))
    return sheet(skull.at(rise, around, reach - radii), (3.0, 2.0))
