"""Hats, masks, hands, things, jewellery: where they are."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.appearance.accessories.before_face.hands import POSES, draw_hand, hand_meshes
from datagen.appearance.accessories.before_face.held import HELD, draw_held, held_meshes
from datagen.appearance.accessories.before_face.masks import MASKS, draw_mask, mask_meshes
from datagen.appearance.accessories.before_face.occluders import THINGS, draw_thing, thing_meshes
from datagen.appearance.accessories.clothing.body import fit_body
from datagen.appearance.accessories.hats.headwear import HATS, draw_headwear
from datagen.appearance.accessories.hats.headwear_meshes import headwear_meshes
from datagen.appearance.accessories.jewellery import PIERCINGS, SOUND, Jewellery, jewellery_meshes
from datagen.appearance.accessories.weaves import WEAVES, layer_of, weave_textures
from datagen.appearance.person import draw_person
from datagen.appearance.solids import box, ellipsoid, lathe, tube
from tests.datagen.appearance.accessories.heads import outside_mm, random_head

OUTSIDE = ("skin", "brows", "lips", "scalp", "neck")
SKIN = (0.5, 0.3, 0.2)


@pytest.mark.parametrize("kind", [hat for hat in HATS if hat != "party"])  # whose cone reaches into hair
def test_hats_are_outside_the_head_and_above_the_eyes(kind: str) -> None:
    for seed in range(1, 5):
        rng = np.random.default_rng(seed)
        head = random_head(seed)
        hat = replace(draw_headwear(rng, draw_person(rng)), kind=kind, lift_deg=0.0, tilt_deg=0.0, turn_deg=0.0)
        meshes = headwear_meshes(hat, head, fit_body(head, np.eye(3)))
        assert {mesh.label for mesh in meshes} == {"headwear"}
        shell = meshes[0].vertices
        upper = shell[shell[:, 1] > 60]
        assert np.quantile(outside_mm(upper, head, OUTSIDE), 0.02) > -1
        eyes = head.vertices[head.model.landmarks["ibug68"][36:48]]
        low = (np.abs(shell[:, 0]) < 45) & (shell[:, 2] > 80) & (shell[:, 1] > -20)
        assert shell[low, 1].min(initial=1e3) > eyes[:, 1].max() + 5


@pytest.mark.parametrize("kind", MASKS)
def test_masks_cover_the_mouth(kind: str) -> None:
    for seed in range(1, 4):
        head = random_head(seed)
        mask = replace(draw_mask(np.random.default_rng(seed)), kind=kind, is_below_nose=False)
        made = mask_meshes(mask, head, fit_body(head, np.eye(3)))[0]
        lips = head.vertices[head.model.landmarks["ibug68"][48:60]].astype(np.float64)
        for lip in lips:
            beside = np.abs(made.vertices[:, :2] - lip[:2]).max(axis=1) < (16 if kind == "veil" else 9)
            assert (made.vertices[beside, 2] > lip[2] - 1).any()
        eyes = head.vertices[head.model.landmarks["ibug68"][36:48]]
        if kind != "veil":
            assert made.vertices[:, 1].max() < eyes[:, 1].min()


@pytest.mark.parametrize("pose", POSES)
def test_hands_touch_faces_and_do_not_enter_them(pose: str) -> None:
    for seed in range(4):
        head = random_head(seed)
        hand = replace(draw_hand(np.random.default_rng(seed), 0.3), pose=pose, is_pair=False)
        meshes = hand_meshes(hand, head, SKIN)
        fingers = np.concatenate([mesh.vertices for mesh in meshes if mesh.name != "hand/sleeve"])
        outside = outside_mm(fingers, head, (*OUTSIDE, "eyes", "ears"))
        assert np.quantile(outside, 0.005) > -6
        if POSES[pose].touches:
            assert outside.min() < 15
        assert {mesh.label for mesh in meshes} == {"occluder"}


def test_left_hands_are_right_ones_mirrored() -> None:
    head = random_head(0)
    hand = replace(draw_hand(np.random.default_rng(1), 0.3), pose="cheek", is_pair=False)
    right, left = (hand_meshes(replace(hand, is_left=is_left), head, SKIN)[0] for is_left in (False, True))
    np.testing.assert_allclose(right.vertices * [-1, 1, 1], left.vertices, atol=1.0)


@pytest.mark.parametrize("kind", THINGS)
def test_things_stand_before_the_head(kind: str) -> None:
    for seed in range(10):
        thing = replace(draw_thing(np.random.default_rng(seed)), kind=kind)
        towards = np.array([np.sin(np.deg2rad(thing.azimuth_deg)), 0, np.cos(np.deg2rad(thing.azimuth_deg))])
        middle = np.mean([mesh.vertices.mean(axis=0) for mesh in thing_meshes(thing)], axis=0)
        assert middle @ towards > 90


@pytest.mark.parametrize("kind", HELD)
def test_what_is_held_is_at_mouth_or_ear(kind: str) -> None:
    for seed in range(5):
        head = random_head(seed)
        held = replace(draw_held(np.random.default_rng(seed)), kind=kind)
        points = np.concatenate([mesh.vertices for mesh in held_meshes(held, head)])
        ears = head.model.vertices_of("ears")
        lips = head.vertices[head.model.landmarks["ibug68"][62]]
        goal = head.vertices[ears] if kind == "phone at ear" else lips[None]
        near = np.linalg.norm(points[:, None] - goal[None, ::20], axis=2).min()
        assert near < (170 if kind == "phone before face" else 70)


@pytest.mark.parametrize(
    "made",
    [
        box((2.0, 3.0, 4.0)),
        ellipsoid((1.0, 2.0, 3.0)),
        lathe(np.array([[0.0, 5.0], [3.0, 4.0], [3.0, 0.0]])),
        tube(np.array([[0.0, 0, 0], [0, 0, 10], [0, 1, 20]]), 1.0),
    ],
)
def test_solids_look_outward(made: object) -> None:
    a, b, c = (made.vertices[made.triangles[:, k]] for k in range(3))  # type: ignore[attr-defined]
    normals = np.cross(b - a, c - a)
    outward = (a + b + c) / 3 - made.vertices.mean(axis=0)  # type: ignore[attr-defined]
    assert ((normals * outward).sum(axis=1) > -1e-6).all()
    assert ((normals * made.normals[made.triangles].mean(axis=1)).sum(axis=1) > -1e-6).all()  # type: ignore[attr-defined]


def test_weaves_are_small_tile_and_keep_the_colour() -> None:
    pixels = weave_textures()[WEAVES].pixels
    assert pixels.nbytes < 4 << 20
    assert np.ptp(pixels[layer_of("plaid"), ..., 1]) > 150
    jersey = pixels[layer_of("jersey")].astype(float)
    assert jersey[..., 0].mean() == pytest.approx(0.8 * 255, abs=3)
    assert np.abs(jersey[:, 0, 0] - jersey[:, -1, 0]).mean() < 3 * np.abs(np.diff(jersey[..., 0], axis=1)).mean()


def _jewellery(**worn: object) -> Jewellery:
    nothing = Jewellery(
        earrings="none", one_ear=False, piercing="none", necklace=0, sound="none", size=0.5,
        metal=(0.5, 0.5, 0.5), stone=(0.5, 0.5, 0.5), gear=(0.1, 0.1, 0.1),
    )  # fmt: skip
    return replace(nothing, **worn)  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", [kind for kind in SOUND if kind != "none"])
def test_what_plays_sits_at_both_ears_and_leaves_the_face_free(kind: str) -> None:
    for seed in range(4):
        head = random_head(seed)
        (mesh,) = jewellery_meshes(_jewellery(sound=kind), head, fit_body(head, np.eye(3)))
        points = mesh.vertices.astype(np.float64)
        ears = head.model.vertices_of("ears")
        for side in (1, -1):
            ear = head.vertices[[vertex for vertex in ears if side * head.vertices[vertex, 0] > 0]]
            nearest = np.linalg.norm(points[:, None] - ear[None, ::20], axis=2).min()
            assert nearest > 30 if kind == "round neck" else nearest < 15
        # Between the ears' front and the nose nothing is on the cheeks but the arm of a headset.
        cheeks = (np.abs(points[:, 0]) < 50) & (points[:, 2] > 70) & (np.abs(points[:, 1]) < 60)
        assert cheeks.any() == (kind == "headset")
        if kind in ("headphones", "headset"):  # over the crown, upon it
            band = points[points[:, 1] > 90]
            assert len(band)
            assert np.quantile(outside_mm(band, head, ("scalp", "skin")), 0.05) > -2


@pytest.mark.parametrize("kind", [kind for kind in PIERCINGS if kind != "none"])
def test_piercings_are_in_the_skin(kind: str) -> None:
    for seed in range(4):
        head = random_head(seed)
        (mesh,) = jewellery_meshes(_jewellery(piercing=kind), head, fit_body(head, np.eye(3)))
        outside = outside_mm(mesh.vertices.astype(np.float64), head, ("skin", "brows", "lips"))
        assert outside.min() < 1.5  # it touches
        assert outside.max() < 12
        assert outside.max() > 0.3
