import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from datagen.appearance.accessories.clothing.body import fit_body
from datagen.appearance.accessories.clothing.clothes import GARMENTS, draw_clothes
from datagen.appearance.accessories.clothing.clothes_meshes import clothes_meshes
from datagen.appearance.accessories.coverage import mean_head
from datagen.appearance.accessories.head_fit import neck_rim
from datagen.appearance.person import draw_person
from tests.datagen.appearance.accessories.heads import outside_mm, random_head

SKIN = (0.5, 0.3, 0.2)


def some_turn(seed: int) -> np.ndarray:
    degrees = np.random.default_rng(seed).uniform(-1, 1, size=3) * [70, 30, 25]
    return Rotation.from_euler("yxz", degrees, degrees=True).as_matrix()


@pytest.mark.parametrize("seed", range(30))
def test_shoulders_join_the_neck_without_a_gap(seed: int) -> None:
    head = random_head(seed)
    body = fit_body(head, some_turn(seed))
    rim, _ = neck_rim(head.model)
    np.testing.assert_array_equal(body.points[0], head.vertices[rim[::-1]])
    np.testing.assert_allclose(body.points[:, 0], body.points[:, -1], atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(body.normals, axis=2), 1, atol=1e-4)
    # What laps under the rim is below the skin.
    assert np.median(outside_mm(body.lap, head, ("neck", "skin", "scalp"))) < -0.3
    # No ring is pinched: the neck keeps its girth, however it is turned.
    girth = np.linalg.norm(np.diff(body.points[:9], axis=1), axis=2).sum(axis=1)
    assert girth.min() > 0.75 * girth[0]
    assert girth.max() < 1.45 * girth[0]
    # Shading goes on over the rim: the normals of neighbours differ little.
    cosine = (body.normals[0] * body.normals[1]).sum(axis=1)
    assert np.quantile(cosine, 0.05) > 0.6


def test_the_thinned_skin_is_one_surface_where_the_whole_one_was() -> None:
    body = fit_body(mean_head(), np.eye(3))
    thin, grid = body.skin(1.0), body.points
    rim = grid[0]
    assert len(thin.triangles) < 0.65 * 2 * (len(grid) - 1) * (len(rim) - 1)
    # Each edge is run through once in each direction, but for those of the ends and of the seam at the back.
    edges = np.concatenate([thin.triangles[:, [k, (k + 1) % 3]] for k in range(3)])
    assert len(np.unique(edges, axis=0)) == len(edges)
    back = {(b, a) for a, b in edges.tolist()}
    alone = sum(edge not in back for edge in map(tuple, edges.tolist()))
    columns, rows = len(rim), len(grid) + 1
    assert alone == (columns - 1) + (columns - 1) // 2 + 2 * (rows - 1)
    # What was left out stands out of the surface that is left by little.
    middle = 0.5 * (grid[3:, :-1:2] + grid[3:, 2::2])
    raised = np.abs(np.einsum("rcx,rcx->rc", grid[3:, 1::2] - middle, body.normals[3:, 1::2]))
    assert np.median(raised) < 0.3
    assert raised.max() < 1.5
    # And it faces outward, as its normals do.
    a, b, c = (thin.vertices[thin.triangles[:, k]] for k in range(3))
    across, normal = np.cross(b - a, c - a), thin.normals[thin.triangles].mean(axis=1)
    area = np.linalg.norm(across, axis=1)
    assert (np.einsum("tc,tc->t", across, normal)[area > 1e-3] > 0).mean() > 0.99


def test_shoulders_turn_with_the_torso() -> None:
    head = random_head(0)
    turn = Rotation.from_euler("y", 40, degrees=True)
    straight, turned = fit_body(head, np.eye(3)), fit_body(head, turn.as_matrix())
    across = straight.points[-1, 69] - straight.points[-1, 23]
    np.testing.assert_allclose(turn.apply(across), turned.points[-1, 69] - turned.points[-1, 23], atol=1e-2)
    np.testing.assert_array_equal(straight.points[0], turned.points[0])


def test_shoulders_are_as_wide_as_peoples() -> None:
    body = fit_body(random_head(0), np.eye(3))
    assert 400 < np.ptp(body.points[..., 0]) < 480
    assert body.points[..., 1].min() < -400


@pytest.mark.parametrize("seed", range(30))
def test_garments_lie_on_the_body_and_leave_the_face_free(seed: int) -> None:
    rng = np.random.default_rng(seed)
    head = random_head(seed)
    clothes = draw_clothes(rng, draw_person(rng), 0.3, 0.2)
    body = fit_body(head, np.eye(3), clothes.breadth)
    meshes = clothes_meshes(clothes, body, SKIN)
    chin = head.vertices[head.model.landmarks["ibug68"][8]]
    for mesh in meshes:
        in_front = mesh.vertices[(mesh.vertices[:, 2] > chin[2] - 8) & (np.abs(mesh.vertices[:, 0]) < 60)]
        assert (in_front[:, 1] < chin[1] + 25).all(), mesh.name
    skin, garment = meshes[:2]
    # The skin reaches under the garment wherever the garment begins.
    edge = garment.vertices.reshape(-1, 49, 3)[0]
    assert skin.vertices[:, 1].min() < edge[:, 1].min() + 1


def test_everybody_wears_something_and_every_garment_is_worn() -> None:
    rng = np.random.default_rng(0)
    worn = {draw_clothes(rng, draw_person(rng), 0.3, 0.2).garment for _ in range(400)}
    assert worn == set(GARMENTS)


def test_colours_are_mostly_muted() -> None:
    rng = np.random.default_rng(0)
    colours = np.array([draw_clothes(rng, draw_person(rng), 0.3, 0.2).colour for _ in range(400)])
    srgb = colours ** (1 / 2.2)
    saturation = (srgb.max(axis=1) - srgb.min(axis=1)) / np.maximum(srgb.max(axis=1), 1e-3)
    assert np.mean((saturation > 0.55) & (srgb.max(axis=1) > 0.45)) < 0.15
