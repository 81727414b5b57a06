from collections import Counter
from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from datagen.appearance.accessories.accessories import (
    Accessories,
    accessory_meshes,
    accessory_textures,
    draw_accessories,
    hidden_hair,
    most_hidden,
)
from datagen.appearance.accessories.accessories_config import HARD_ACCESSORIES, AccessoriesConfig
from datagen.appearance.accessories.coverage import mean_head, visible_share
from datagen.appearance.person import draw_person
from datagen.appearance.scene import SCENE_LABELS
from pix2face.errors import UsageError
from tests.datagen.appearance.accessories.heads import random_head

SKIN, HAIR = (0.5, 0.3, 0.2), (0.05, 0.03, 0.02)


def drawn(seed: int, config: AccessoriesConfig | None = None) -> Accessories:
    rng = np.random.default_rng(seed)
    return draw_accessories(rng, config or AccessoriesConfig(), draw_person(rng))


@pytest.mark.parametrize("seed", range(20))
def test_meshes_are_sound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = Rotation.from_euler("yxz", rng.normal(size=3) * [30, 10, 10], degrees=True).as_matrix()
    meshes = accessory_meshes(drawn(seed, HARD_ACCESSORIES), random_head(seed % 10), SKIN, HAIR, turn)
    names = accessory_textures()
    for mesh in meshes:
        assert np.isfinite(mesh.vertices).all(), mesh.name
        assert np.isfinite(mesh.uv).all(), mesh.name
        assert mesh.triangles.min() >= 0, mesh.name
        assert mesh.triangles.max() < len(mesh.vertices), mesh.name
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-4, err_msg=mesh.name)
        assert len(mesh.vertices) == len(mesh.normals) == len(mesh.uv)
        assert mesh.label in SCENE_LABELS
        assert np.abs(mesh.vertices).max() < 1200, mesh.name
        if mesh.material.texture:
            assert mesh.material.layer < len(names[mesh.material.texture].pixels)
    assert "clothes" in {mesh.label for mesh in meshes}
    assert sum(len(mesh.triangles) for mesh in meshes) < 30_000


def test_the_same_seed_gives_the_same() -> None:
    first, second = drawn(3, HARD_ACCESSORIES), drawn(3, HARD_ACCESSORIES)
    assert first == second
    head = random_head(1)
    one = accessory_meshes(first, head, SKIN, HAIR, np.eye(3))
    other = accessory_meshes(second, head, SKIN, HAIR, np.eye(3))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.vertices, b.vertices)
    assert drawn(4) != drawn(5)


def test_shares_are_those_of_the_configuration() -> None:
    config = AccessoriesConfig(least_visible=0.0)
    count: Counter[str] = Counter()
    n, men = 800, 0
    for seed in range(n):
        rng = np.random.default_rng(seed)
        person = draw_person(rng)
        accessories = draw_accessories(rng, config, person)
        men += person.femininity < 0.5
        count.update(field.name for field in fields(accessories) if getattr(accessories, field.name) is not None)
        if accessories.glasses is not None and accessories.glasses.rim != "goggles":
            count["dark"] += accessories.glasses.lens_alpha >= 0.7
    wanted = {"glasses": 0.24, "dark": 0.04, "headwear": 0.10, "hand": 0.07, "thing": 0.05, "held": 0.03, "mask": 0.03}
    for name, share in wanted.items():
        assert count[name] / n == pytest.approx(share, abs=4 * np.sqrt(share / n) + 0.002), name
    assert count["beard"] / men == pytest.approx(0.30, abs=0.05)
    assert count["clothes"] == n


@pytest.mark.parametrize(("config", "least"), [(AccessoriesConfig(), 0.40), (HARD_ACCESSORIES, 0.30)])
def test_most_of_a_face_stays_visible(config: AccessoriesConfig, least: float) -> None:
    most_hidden = 1.0
    for seed in range(60):
        accessories = drawn(seed, replace(config, hand=0.5, thing=0.6, mask=0.2))
        meshes = accessory_meshes(accessories, mean_head(), SKIN, HAIR, np.eye(3))
        before = [mesh for mesh in meshes if mesh.label not in ("clothes", "beard", "jewellery")]
        most_hidden = min(most_hidden, visible_share(before))
    assert most_hidden >= least
    assert most_hidden < 0.75  # and some hide a good part


def test_hats_hide_the_hair_above_their_rim() -> None:
    for seed in range(200):
        accessories = drawn(seed, AccessoriesConfig(headwear=1.0, glasses=0, sunglasses=0))
        plane = hidden_hair(accessories)
        if accessories.headwear is None or accessories.headwear.kind in ("headband", "crown", "party"):
            assert plane is None
            continue
        assert plane is not None
        np.testing.assert_allclose(np.linalg.norm(plane.normal), 1, atol=1e-4)
        above = (np.array([0.0, 140.0, -20.0]) - plane.point) @ plane.normal
        below = (np.array([0.0, -450.0, 60.0]) - plane.point) @ plane.normal
        assert above > 0 > below


def test_another_share_changes_no_other_part() -> None:
    plain = drawn(11, AccessoriesConfig(least_visible=0.0))
    hats = drawn(11, AccessoriesConfig(headwear=1.0, least_visible=0.0))
    assert hats.headwear is not None
    assert replace(plain.clothes, scarf=0.0) == replace(hats.clothes, scarf=0.0)
    assert plain.beard == hats.beard


def test_nobody_wears_two_pairs_of_glasses() -> None:
    with pytest.raises(
        UsageError, match=r"accessories\.glasses: expected at most 1 together with sunglasses, found 1\.2"
    ):
        AccessoriesConfig(glasses=0.8, sunglasses=0.4).check()


@pytest.mark.parametrize("kind", ["glasses", "goggles", "headwear", "mask", "held"])
def test_nothing_hides_more_than_it_is_taken_to(kind: str) -> None:
    """Where bounds leave enough, nobody measures."""
    none = dict.fromkeys(("glasses", "sunglasses", "goggles", "headwear", "mask", "held", "hand", "thing"), 0.0)
    shares = {"sunglasses": 1.0, "goggles": 1.0} if kind == "goggles" else {kind: 1.0}
    config = AccessoriesConfig(**{**none, **shares, "least_visible": 0.0})
    for seed in range(40):
        accessories = drawn(seed, config)
        worn = {name: getattr(accessories, name) for name in ("glasses", "headwear", "mask", "held")}
        alone = replace(accessories, beard=None)
        meshes = [
            mesh
            for mesh in accessory_meshes(alone, mean_head(), SKIN, HAIR, np.eye(3))
            if mesh.label not in ("clothes", "jewellery")
        ]
        assert sum(part is not None for part in worn.values()) == 1
        assert 1 - visible_share(meshes) <= most_hidden(alone) < 1
