"""Which hair people get, its colours, and what becomes of it: aside, cut, under a hat, as JSON."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.appearance.accessories.hats.headwear_meshes import FEDORA_CROWN, fedora_mesh
from datagen.appearance.hair.bound_meshes import bound_mesh
from datagen.appearance.hair.hair import LAYERS, Hair, draw_hair, hair_meshes, hair_textures, hair_uniforms
from datagen.appearance.hair.hair_colour import melanin_to_linear
from datagen.appearance.hair.hair_config import HARD_HAIR, HairConfig
from datagen.appearance.hair.shape import FREE_AT_MM, FREE_MM, CrownPlane, comb_aside, find_parting
from datagen.appearance.hair.styles import STYLES, UNCUT_MM, WITHOUT_MESH, Hairdo
from datagen.appearance.person import Person, draw_person
from datagen.appearance.scene import SCENE_LABELS, PosedHead, Surface
from pix2face.models.morphable_model import MorphableModel, builtin_model

SOMEBODY = Person(age_years=30, femininity=0.5, african=0.3, asian=0.3, caucasian=0.4, melanin=0.4)
NO_HAT = None


@pytest.fixture(scope="module")
def head() -> PosedHead:
    model: MorphableModel = builtin_model()
    normals = Surface(model).normals(model.mean)
    return PosedHead(model=model, vertices=model.mean, normals=normals, neutral=model.mean)


def _hair(style: str, **changes: object) -> Hair:
    hairdo = Hairdo(
        style=style, cap="", is_mirrored=False, length=1.0, cut_mm=UNCUT_MM, volume=1.0, aside=0.0, sway_mm=0.0,
        density=1.0, thinning=0.0, scalp_density=0.7,
    )  # fmt: skip
    drawn = draw_hair(np.random.default_rng(0), HairConfig(no_brows_share=0.0), SOMEBODY)
    return replace(drawn, hairdo=replace(hairdo, **changes))  # type: ignore[arg-type]


def _many(config: HairConfig, n: int, **traits: float) -> list[Hair]:
    found = []
    for index in range(n):
        rng = np.random.default_rng([7, index])
        found.append(draw_hair(rng, config, replace(draw_person(rng), **traits)))
    return found


@pytest.mark.parametrize("config", [HairConfig(), HARD_HAIR])
def test_colours_are_within_0_and_1(config: HairConfig) -> None:
    for hair in _many(config, 40):
        colours = np.array([hair.colour.base, hair.colour.tips, hair.colour.highlight, hair.brows.colour])
        assert (colours >= 0).all()
        assert (colours <= 1).all()


def test_everybody_may_have_every_style_but_not_as_often() -> None:
    women, men = ([hair.hairdo.style for hair in _many(HairConfig(), 700, femininity=sex)] for sex in (1.0, 0.0))
    assert set(women) | set(men) == {*STYLES, *WITHOUT_MESH}
    assert len(set(men) & {"long01", "bob01", "bob02", "ponytail01"}) >= 2
    long_women = np.mean([style in STYLES and STYLES[style].is_long for style in women])
    long_men = np.mean([style in STYLES and STYLES[style].is_long for style in men])
    assert long_women > 2.5 * long_men
    assert np.mean([style in WITHOUT_MESH for style in men]) == pytest.approx(0.24, abs=0.05)


def test_hair_that_covers_much_of_the_face_is_kept_rare() -> None:
    hanging = [
        hair.hairdo.style in ("bob01", "bob02", "braid01", "short03") and hair.hairdo.aside < 0.5
        for hair in _many(HairConfig(), 800)
    ]
    assert 0.02 < np.mean(hanging) < 0.12


def test_hair_is_never_blue_by_itself_and_greys_with_age() -> None:
    config = HairConfig(vivid_share=0.0)
    for hair in _many(config, 200):
        red, green, blue = hair.colour.base
        assert red >= green >= blue
    young, old = (
        np.mean([hair.colour.grey_share for hair in _many(config, 200, age_years=age)]) for age in (25.0, 80.0)
    )
    assert young < 0.02
    assert old > 0.6


def test_more_pigment_is_darker() -> None:
    tones = np.stack([melanin_to_linear(amount, 0.2) for amount in (0.05, 0.3, 1.0, 3.0, 8.0)])
    assert (np.diff(tones, axis=0) < 0).all()
    assert tones[0].mean() > 0.4
    assert tones[-1].max() < 0.03
    red = melanin_to_linear(0.2, 2.0)
    assert red[0] > 2 * red[1] > 4 * red[2]


@pytest.mark.parametrize("style", LAYERS)
def test_every_style_gives_meshes_that_can_be_drawn(style: str, head: PosedHead) -> None:
    hair = _hair(style, aside=0.9, volume=1.2, length=0.7, sway_mm=5.0, is_mirrored=True)
    meshes = hair_meshes(hair, head)
    assert [mesh.label for mesh in meshes] == ["hair", "head", "head"]
    textures = hair_textures()
    for mesh in meshes:
        assert mesh.label in SCENE_LABELS
        assert np.isfinite(mesh.vertices).all()
        assert mesh.triangles.max() < len(mesh.vertices) == len(mesh.uv) == len(mesh.normals)
        assert mesh.material.layer < len(textures[mesh.material.texture].pixels)
    assert set(hair_uniforms(hair)) == {"hair_tips", "hair_highlight", "hair_grey", "hair_mix", "hair_reach"}


def test_no_hair_no_mesh(head: PosedHead) -> None:
    hair = _hair("bald")
    hair = replace(hair, brows=replace(hair.brows, alpha=0.0), lashes=replace(hair.lashes, alpha=0.0))
    assert hair_meshes(hair, head) == []


@pytest.mark.parametrize("style", ["bob01", "bob02", "braid01", "short03"])
def test_hair_combed_aside_leaves_the_face_free(style: str) -> None:
    mesh, picture = bound_mesh(style), hair_textures()["hair_strands"].pixels[LAYERS.index(style)][..., :2]
    parting = find_parting(mesh, picture)
    points = mesh.mean.copy()
    comb_aside(points, parting, 1.0)
    corners = mesh.mean[mesh.point_of_vertex[mesh.triangles]].mean(axis=1)
    moved = points[mesh.point_of_vertex[mesh.triangles]].mean(axis=1)

    def before_the_face(places: np.ndarray) -> int:
        free = np.interp(places[:, 1], FREE_AT_MM, FREE_MM) - 16
        return int(((np.abs(places[:, 0]) < free) & (places[:, 2] > 60) & (np.abs(places[:, 1] - 10) < 40)).sum())

    assert before_the_face(moved) <= 0.15 * before_the_face(corners)
    untouched = mesh.mean.copy()
    comb_aside(untouched, parting, 0.0)
    # Strands inside the gap, which are transparent there, alone are brought to its ends.
    assert np.quantile(np.abs(untouched[:, 0] - mesh.mean[:, 0]), 0.98) < 1e-3


@pytest.mark.parametrize("style", LAYERS)
def test_a_hat_leaves_no_hair_above_its_rim(style: str, head: PosedHead) -> None:
    mesh = hair_meshes(_hair(style), head, FEDORA_CROWN)[0]
    above = mesh.vertices[np.unique(mesh.triangles)] - np.array(FEDORA_CROWN.point)
    assert (above @ np.array(FEDORA_CROWN.normal)).max() < 16
    assert len(mesh.triangles) < len(hair_meshes(_hair(style), head, NO_HAT)[0].triangles)
    nothing = hair_meshes(_hair(style), head, CrownPlane((0.0, -900.0, 0.0), (0.0, 1.0, 0.0)))[0]
    assert not len(nothing.triangles)


def test_the_fedora_sits_on_the_head(head: PosedHead) -> None:
    hat = fedora_mesh(head, (0.1, 0.1, 0.1))
    assert hat.label == "headwear"
    assert hat.vertices[:, 1].max() > head.vertices[:, 1].max()
    on_top = head.vertices[head.vertices[:, 1] > 110]
    assert np.abs(hat.vertices[:, 0]).max() > np.abs(on_top[:, 0]).max()
    assert "hair_fedora" in hair_textures()


def test_brows_and_lashes_follow_the_expression_and_hair_does_not(head: PosedHead) -> None:
    model = head.model
    raised = model.named_expressions["browInnerUp"][None]
    moved = model.vertices(np.zeros((1, model.n_identity)), raised)[0]
    raised_head = replace(head, vertices=moved, normals=Surface(model).normals(moved))
    before, after = hair_meshes(_hair("short01"), head), hair_meshes(_hair("short01"), raised_head)
    np.testing.assert_array_equal(before[0].vertices, after[0].vertices)
    assert (after[1].vertices - before[1].vertices)[:, 1].max() > 2


def test_a_cap_lies_below_the_first_style(head: PosedHead) -> None:
    names = [mesh.name for mesh in hair_meshes(_hair("ponytail01", cap="short04"), head)]
    assert names[:2] == ["hair/short04", "hair/ponytail01"]
