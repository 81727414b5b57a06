"""Objects between the camera and the face: boxes, balls, poles, leaves, sheets with text, fences, other people."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64
from numpy import ndarray
from scipy.spatial.transform import Rotation

from datagen.appearance.accessories.materials import (
    WHITE,
    cloth,
    cut_out,
    draw_cloth_colour,
    draw_tint,
    skin_material,
    smooth,
)
from datagen.appearance.scene import Colour, Material, SceneMesh
from datagen.appearance.solids import Solid, box, ellipsoid, joined, scene_mesh, sheet, tube
from datagen.random_streams import rounded, triple, weighted_choice

# Weights of the objects.
_WEIGHTS = {"box": 0.12, "ball": 0.08, "pole": 0.10, "leaves": 0.10, "paper": 0.12, "panel": 0.16, "lattice": 0.05}
_WEIGHTS |= {"person": 0.15, "cloth": 0.12}
THINGS = tuple(_WEIGHTS)
CENTRE = np.array([0.0, 10.0, 30.0])
_PANEL_WEAVES = ("jersey", "wood", "print", "paper", "plaid", "flowers", "leather", "check", "brushed", "camouflage")


@final
@dataclass(frozen=True, kw_only=True)
class Thing:
    """An object between the camera and the face."""

    kind: str  # one of `THINGS`
    azimuth_deg: float  # direction from the head: 0 is straight ahead, positive towards the subject's left
    elevation_deg: float
    distance_mm: float  # from the centre of the head
    aside_deg: float  # direction of the offset from the line of sight
    aside_mm: float  # length of this offset
    size: float  # factor on its usual size
    turn_deg: float  # rotation about the line of sight
    tip_deg: float  # rotation about the horizontal
    weave: str
    colour: Colour  # linear
    second: Colour  # linear colour of the pattern or of the hair
    seed: int  # for the details


def draw_thing(rng: np.random.Generator) -> Thing:
    """Draws an object that is at least partly in front of the face."""
    kind = weighted_choice(rng, _WEIGHTS)
    weave = {"paper": "paper", "lattice": "lattice", "leaves": "leaf"}.get(kind) or str(rng.choice(_PANEL_WEAVES))
    green = draw_tint(rng, 0.6, float(rng.uniform(0.3, 0.6)))
    colour = draw_cloth_colour(rng) if rng.uniform() < 0.6 else draw_tint(rng, float(rng.uniform(0.2, 0.9)), 0.6)
    if kind == "leaves":
        colour = (round(0.4 * green[1], 4), max(green), round(0.25 * green[1], 4))
    if kind == "paper":
        colour = WHITE
    tone = float(rng.uniform())
    if kind == "person":
        colour = triple((0.62 - 0.5 * tone, 0.42 - 0.37 * tone, 0.33 - 0.30 * tone))
    return Thing(
        kind=kind,
        azimuth_deg=rounded(np.clip(rng.normal(0, 40), -85, 85), 2),
        elevation_deg=rounded(rng.normal(0, 12), 2),
        distance_mm=rounded(rng.uniform(170, 280), 2),
        aside_deg=rounded(rng.uniform(0, 360), 2),
        aside_mm=rounded(rng.uniform(25, 110), 2),
        size=rounded(np.exp(rng.normal(0, 0.35))),
        turn_deg=rounded(rng.uniform(-180, 180) if kind != "person" else rng.normal(0, 12), 2),
        tip_deg=rounded(rng.normal(0, 15), 2),
        weave=weave,
        colour=colour,
        second=draw_cloth_colour(rng) if kind != "paper" else (0.02, 0.02, 0.03),
        seed=int(rng.integers(2**31)),
    )


def thing_meshes(thing: Thing) -> list[SceneMesh]:
    """Makes the meshes of an object in the model frame, independent of the head."""
    turn, place = _placed(thing)
    if thing.kind == "person":
        pieces = _person(thing)
    elif thing.kind in ("lattice", "leaves"):
        made = _lattice() if thing.kind == "lattice" else _leaves(thing)
        pieces = [(made, cut_out(thing.weave, thing.colour, thing.second, 0.6))]
    elif thing.kind in ("ball", "pole"):
        pieces = [(_plain(thing), smooth(thing.colour, 0.35))]
    else:
        pieces = [(_plain(thing), cloth(thing.weave, thing.colour, thing.second, 0.75))]
    return [
        scene_mesh(f"occluder/{thing.kind}{i}", "occluder", made.placed(turn, place, thing.size), material)
        for i, (made, material) in enumerate(pieces)
    ]


def _placed(thing: Thing) -> tuple[Float64[ndarray, "3 3"], Float64[ndarray, "3"]]:
    """Returns the axes (x to the right as seen from the object, y up, z away from the face) and the place."""
    view = Rotation.from_euler("yx", [thing.azimuth_deg, -thing.elevation_deg], degrees=True)
    own = Rotation.from_euler("zx", [thing.turn_deg, thing.tip_deg], degrees=True)
    aside = np.deg2rad(thing.aside_deg)
    # Large objects are moved by half their size more, so that their edge is in front of the face.
    half_mm = {"panel": 95.0, "person": 70.0, "cloth": 75.0, "box": 40.0, "paper": 60.0}.get(thing.kind, 0.0)
    reach = thing.aside_mm + half_mm * thing.size
    local = np.array([np.cos(aside) * reach, np.sin(aside) * reach, thing.distance_mm])
    if thing.kind == "person":  # a shoulder or a head comes from the side or from below
        local[1] = -abs(local[1])
    return (view * own).as_matrix(), CENTRE + view.apply(local)


def _plain(thing: Thing) -> Solid:
    rng = np.random.default_rng(thing.seed)
    if thing.kind == "box":
        size = rng.uniform([50, 60, 20], [120, 150, 70])
        return box((float(size[0]), float(size[1]), float(size[2])))
    if thing.kind == "ball":
        radius = float(rng.uniform(25, 60))
        return ellipsoid((radius, radius, radius), 13, 20)
    if thing.kind == "pole":
        radius = float(rng.uniform(6, 22))
        return tube(np.array([[0.0, y, 0.0] for y in (-600, -200, 200, 600)]), radius, (0, 0, 1), 14)
    if thing.kind == "paper":
        bend = float(rng.uniform(-30, 30))
        x, y = np.meshgrid(np.linspace(-75, 75, 9), np.linspace(105, -105, 9))
        return sheet(np.stack([x, y, bend * (x / 75) ** 2], axis=-1))
    if thing.kind == "cloth":
        x, y = np.meshgrid(np.linspace(-95, 95, 25), np.linspace(200, -200, 25))
        waves = sum(np.sin(x * rng.uniform(0.02, 0.12) + y * rng.normal(0, 0.02) + rng.uniform(0, 6)) for _ in range(3))
        return sheet(np.stack([x + 3 * waves, y, 6 * waves], axis=-1), (3.0, 6.0))
    return box((200.0, 260.0, 4.0), float(rng.uniform(1, 3)))


def _lattice() -> Solid:
    x, y = np.meshgrid(np.linspace(-320, 320, 2), np.linspace(320, -320, 2))
    return sheet(np.stack([x, y, 0 * x], axis=-1), (9.0, 9.0))


def _leaves(thing: Thing) -> Solid:
    rng = np.random.default_rng(thing.seed)
    leaves = []
    for _ in range(int(rng.integers(3, 14))):
        long, wide = rng.uniform(35, 110), rng.uniform(15, 45)
        x, y = np.meshgrid(np.linspace(-0.5, 0.5, 4), np.linspace(0, 1, 6))
        bend = rng.uniform(0, 0.3) * long * y**2
        leaf = sheet(np.stack([wide * x, -long * y, -bend + 4 * np.abs(x)], axis=-1))
        turn = Rotation.from_euler("zxy", rng.normal(0, [1.2, 0.5, 0.5])).as_matrix()
        leaves.append(leaf.placed(turn, rng.normal(0, [45, 55, 15])))
    return joined(leaves)


def _person(thing: Thing) -> list[tuple[Solid, Material]]:
    """Makes a person seen from behind or from the side: head, hair, neck, shoulders."""
    head = ellipsoid((76, 108, 92), 13, 20)
    hair = ellipsoid((83, 92, 98), 13, 20).moved(np.array([0.0, 30.0, 14.0]))
    neck = tube(np.array([[0.0, -60, 10], [0, -120, 18], [0, -170, 20]]), 55.0, (0, 0, 1), 12)
    shoulders = ellipsoid((215, 95, 110), 11, 20).moved(np.array([0.0, -245.0, 20.0]))
    chest = tube(np.array([[0.0, -240, 20], [0, -420, 20], [0, -600, 20]]), (200.0, 105.0), (0, 0, 1), 16)
    return [
        (joined([head, neck]), skin_material(thing.colour)),
        (hair, cloth("fleece", triple(0.3 * part for part in thing.second), thing.second, 0.6)),
        (joined([shoulders, chest]), cloth(thing.weave, thing.second, thing.colour)),
    ]
