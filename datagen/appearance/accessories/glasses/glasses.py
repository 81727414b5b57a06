"""Glasses: frames of many shapes with clear, tinted or mirrored lenses, worn as people wear them; goggles."""

import numpy as np

from datagen.appearance.accessories.colours import smooth
from datagen.appearance.accessories.glasses.glasses_choice import Glasses
from datagen.appearance.accessories.glasses.glasses_fit import GlassesFit, fit_glasses
from datagen.appearance.accessories.glasses.glasses_shapes import outline
from datagen.appearance.scene import Material, PosedHead, SceneMesh
from datagen.appearance.solids import Solid, joined, scene_mesh, sheet, solid, tube

OUTLINE = 28  # points around a lens


def glasses_meshes(glasses: Glasses, head: PosedHead) -> list[SceneMesh]:
    """The frame and the lenses."""
    local = [_rim_and_lens(glasses, side) for side in (1, -1)]
    frame = [rim for rim, _ in local if rim is not None]
    frame.append(_bridge(glasses))
    fit = fit_glasses(
        glasses, head, np.concatenate([lens.vertices for _, lens in local] + [one.vertices for one in frame])
    )
    front = joined(frame).placed(fit.rotation, fit.place)
    lenses = joined([lens for _, lens in local]).placed(fit.rotation, fit.place)
    sides = [_strap(fit)] if glasses.rim == "goggles" else [_temple(glasses, fit, side) for side in (1, -1)]
    material = smooth(glasses.colour, 0.28 if glasses.is_metal else 0.35, 0.5 if glasses.is_metal else 0.05)
    glass = Material(
        kind="glass",
        colour=glasses.lens_colour,
        alpha=glasses.lens_alpha,
        roughness=0.08,
        numbers=(glasses.mirror, glasses.gradient, 0.0, 0.0),
        is_blended=True,
    )
    return [
        scene_mesh(f"glasses/{glasses.shape}", "glasses", joined([front, *sides]), material),
        scene_mesh("glasses/lenses", "glasses", lenses, glass, casts_shadow=glasses.lens_alpha > 0.5),
    ]


def _lens_centre_mm(glasses: Glasses) -> float:
    return 0.5 * (glasses.bridge_mm + glasses.width_mm)


def _curved(points: np.ndarray) -> np.ndarray:
    """Bends a flat front around the face: millimetres backward far from the nose."""
    bent = points.copy()
    bent[..., 2] -= 0.0016 * bent[..., 0] ** 2
    return bent


def _rim_and_lens(glasses: Glasses, side: int) -> tuple[Solid | None, Solid]:
    """Of the eye on one side (1 the left); front frame: x to the left, y up, z forward, origin between the lenses."""
    flat = outline(glasses.shape, OUTLINE) * [glasses.width_mm / 2, glasses.height_mm / 2]
    edge = np.stack([side * (flat[:, 0] + _lens_centre_mm(glasses)), flat[:, 1], np.zeros(OUTLINE)], axis=1)
    centre = edge.mean(axis=0)
    rings = np.stack([centre + part * (edge - centre) for part in (0.02, 0.5, 1.0)])
    rings[..., 2] += (1 - np.array([0.0, 0.25, 1.0]))[:, None] * 1.2
    rings = _curved(np.concatenate([rings, rings[:, :1]], axis=1))
    lens = sheet(rings, is_closed=True)
    span = (rings[..., 1] - rings[..., 1].min()) / np.ptp(rings[..., 1])
    uv = np.stack([0.5 + 0.0 * span, 1 - span], axis=-1).reshape(-1, 2)
    lens = solid(lens.vertices, lens.triangles, uv, lens.normals)
    if glasses.rim == "none":
        return None, lens
    path = _curved(np.concatenate([edge, edge[:2]]))
    if glasses.rim == "half":
        path = path[: OUTLINE // 2 + 1]
    half = glasses.thickness_mm
    depth = 14.0 if glasses.rim == "goggles" else min(half, 1.2) + 0.4
    return tube(path, np.tile([[half, depth / 2]], (len(path), 1)), (0, 0, 1), 6, squareness=0.5), lens


def _bridge(glasses: Glasses) -> Solid:
    """Between the lenses, and pads on the nose."""
    half = 0.5 * glasses.bridge_mm + 0.5
    x = np.linspace(-half, half, 7)
    rise = 0.16 * glasses.height_mm + 1.5 * (1 - (x / half) ** 2)
    path = np.stack([x, rise, 1.5 * (1 - (x / half) ** 2)], axis=1)
    thick = max(glasses.thickness_mm, 0.7)
    parts = [tube(path, np.tile([[thick, thick]], (7, 1)), (0, 0, 1), 6)]
    if glasses.shape == "aviator":
        top = path * [1.5, 0, 1] + [0, 0.42 * glasses.height_mm, 0]
        parts.append(tube(top, 0.8, (0, 0, 1), 5))
    return joined(parts)


def _temple(glasses: Glasses, fit: GlassesFit, side: int) -> Solid:
    """From the hinge past the temple to the ear and down behind it."""
    path = fit.temples[side]
    thick = max(0.7, min(glasses.thickness_mm, 1.6))
    tall = thick if glasses.is_metal else max(1.5, 1.6 * glasses.thickness_mm)
    return tube(path, np.tile([[min(thick, 1.2), tall]], (len(path), 1)), (0, 0.6, -0.8), 6, squareness=0.4)


def _strap(fit: GlassesFit) -> Solid:
    """The band of goggles around the head."""
    return tube(fit.strap, np.tile([[1.0, 8.0]], (len(fit.strap), 1)), (0, 1, 0), 6, squareness=0.6)
