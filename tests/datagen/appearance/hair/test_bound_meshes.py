"""What is bound to a head follows it: over random heads and expressions."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy import ndarray

from datagen.appearance.asset_files import open_asset
from datagen.appearance.hair.bound_meshes import BoundMesh, bound_mesh, check_model, mirrored
from datagen.appearance.hair.brows_and_lashes import LASH_STYLES, Brows, brow_mesh, brow_pictures, turned_with_lids
from datagen.appearance.hair.hair import LAYERS
from datagen.appearance.scene import PosedHead, Surface
from pix2face.errors import InputFileError
from pix2face.models.morphable_model import MorphableModel, builtin_model

N_HEADS = 30
PLAIN_BROWS = Brows(
    layer=4, colour=(0.1, 0.1, 0.1), alpha=1.0, density=1.0, thickness=1.0, shift_mm=0.0, apart_mm=0.0, uneven_mm=0.0
)


@pytest.fixture(scope="module")
def model() -> MorphableModel:
    return builtin_model()


@pytest.fixture(scope="module")
def heads(model: MorphableModel) -> list[PosedHead]:
    rng = np.random.default_rng(0)
    return [
        _head(model, rng.normal(size=model.n_identity), rng.normal(size=model.n_expression)) for _ in range(N_HEADS)
    ]


def _head(model: MorphableModel, identity: ndarray, expression: ndarray) -> PosedHead:
    both = model.vertices(np.stack([identity, identity]), np.stack([expression, 0 * expression]))
    vertices, neutral = both.astype(np.float32)
    return PosedHead(model=model, vertices=vertices, normals=Surface(model).normals(vertices), neutral=neutral)


def _skin(model: MorphableModel, vertices: ndarray, *regions: str) -> trimesh.Trimesh:
    chosen = np.isin(model.triangle_regions, [model.region_names.index(name) for name in regions])
    return trimesh.Trimesh(vertices, model.triangles[chosen], process=False)


def _heights(skin: trimesh.Trimesh, points: ndarray) -> ndarray:
    feet, distance, triangle = trimesh.proximity.closest_point(skin, points)
    inside = ((points - feet) * skin.face_normals[triangle]).sum(axis=1) < 0
    return distance * np.where(inside, -1, 1)


@pytest.mark.parametrize("name", [*LAYERS, *LASH_STYLES, "fedora"])
def test_a_mesh_around_the_mean_stays_there_and_moves_with_the_whole_head(name: str, model: MorphableModel) -> None:
    mesh = bound_mesh(name)
    np.testing.assert_array_equal(mesh.displacements(model.mean, model.mean), 0)
    shifted = mesh.displacements(model.mean + np.float32([3, -2, 5]), model.mean)
    np.testing.assert_allclose(shifted, np.tile([3, -2, 5], (len(mesh.mean), 1)), atol=1e-4)
    assert mesh.triangles.max() < len(mesh.point_of_vertex)
    assert mesh.point_of_vertex.max() < len(mesh.mean)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=0.02)


@pytest.mark.parametrize("name", LAYERS)
def test_strands_do_not_tear(name: str, model: MorphableModel, heads: list[PosedHead]) -> None:
    mesh = bound_mesh(name)
    corners = mesh.point_of_vertex[mesh.triangles]
    edges = np.unique(np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]]]), axis=1), axis=0)
    before = np.linalg.norm(np.diff(mesh.mean[edges], axis=1)[:, 0], axis=1)
    for head in heads[:8]:
        points = mesh.mean + mesh.displacements(head.neutral, model.mean)
        after = np.linalg.norm(np.diff(points[edges], axis=1)[:, 0], axis=1)
        torn = np.abs(after - before) - 0.3 * before  # mm; heads differ in size, and with them their hair
        assert torn.max() < 9
        assert np.quantile(torn, 0.99) < 1.5


def test_the_mirror_image_follows_mirrored_heads(model: MorphableModel, heads: list[PosedHead]) -> None:
    assert model.symmetry is not None
    mesh = bound_mesh("short03")
    other_head = heads[0].neutral[model.symmetry] * np.float32([-1, 1, 1])
    there = mirrored(mesh, model.symmetry).displacements(other_head, model.mean)
    here = mesh.displacements(heads[0].neutral, model.mean) * np.float32([-1, 1, 1])
    np.testing.assert_allclose(there, here, atol=2e-3)


def test_brows_lie_upon_the_skin_in_every_expression(model: MorphableModel, heads: list[PosedHead]) -> None:
    for head in heads:
        mesh = brow_mesh(PLAIN_BROWS, head)
        skin = _skin(model, head.vertices, "skin", "brows")
        points = np.concatenate([mesh.vertices, mesh.vertices[mesh.triangles].mean(axis=1)])
        uv = np.concatenate([mesh.uv, mesh.uv[mesh.triangles].mean(axis=1)])
        # Hair alone counts: where the patch is transparent, lids may fold over it.
        hairy = brow_pictures()[..., 1].max(axis=0)
        rows, columns = np.clip(uv[:, 1] * len(hairy), 0, 143), np.clip(uv[:, 0] * hairy.shape[1], 0, 255)
        points = points[hairy[rows.astype(int), columns.astype(int)] > 100]
        assert len(points) > 200
        heights = _heights(skin, points.astype(np.float64))
        assert heights.min() > 0  # in the deepest fold of a lid
        assert np.quantile(heights, 0.01) > 0.3
        assert heights.max() < 3


def test_no_strand_comes_through_the_forehead(model: MorphableModel, heads: list[PosedHead]) -> None:
    meshes = {mesh: mesh.triangles[_over_forehead(mesh)] for mesh in map(bound_mesh, LAYERS)}
    for head in heads[:3]:
        skin = _skin(model, head.neutral.astype(np.float64), "skin", "brows", "scalp")
        for mesh, near in meshes.items():
            if not len(near):
                continue
            points = (mesh.mean + mesh.displacements(head.neutral, model.mean))[mesh.point_of_vertex]
            corners = points[near].astype(np.float64)
            samples = np.concatenate([corners, corners.mean(axis=1, keepdims=True)], axis=1)
            heights = _heights(skin, samples.reshape(-1, 3)).reshape(-1, 4)
            cuts = (heights.min(axis=1) < -0.7) & (heights.max(axis=1) > 0.3)
            assert cuts.sum() <= 0.02 * len(near) + 1


def _over_forehead(mesh: BoundMesh) -> ndarray:
    points = mesh.mean[mesh.point_of_vertex[mesh.triangles]].mean(axis=1)
    with open_asset("hair/meshes.h5") as file:
        over_face = file[mesh.name]["over_face"][()].astype(bool)
    over = over_face[mesh.point_of_vertex[mesh.triangles]].all(axis=1)
    return over & (points[:, 2] > 60) & (points[:, 1] < 72)


@pytest.mark.parametrize("name", LASH_STYLES)
def test_lashes_go_down_with_the_lid(name: str, model: MorphableModel) -> None:
    shut = model.named_expressions["eyeBlinkLeft"] + model.named_expressions["eyeBlinkRight"]
    still = np.zeros(model.n_identity)
    mesh = bound_mesh(name)
    open_head, shut_head = _head(model, still, 0 * shut), _head(model, still, shut)
    on_upper = (mesh.feet[:, 1] > 29) & (np.abs(mesh.feet[:, 0]) < 40)
    before, after = (turned_with_lids(mesh, head, 1.0) for head in (open_head, shut_head))
    np.testing.assert_allclose(before, mesh.mean, atol=1e-3)
    assert (after - before)[on_upper, 1].max() < -4
    lids = _skin(model, shut_head.vertices.astype(np.float64), "skin")
    roots = mesh.feet + mesh.displacements(shut_head.vertices, model.mean)
    assert np.abs(_heights(lids, roots.astype(np.float64))).max() < 0.3  # all hang on a lid, none before the iris alone


def test_lashes_keep_their_length(model: MorphableModel, heads: list[PosedHead]) -> None:
    mesh = bound_mesh("eyelashes02")
    for head in heads:
        roots = mesh.feet + mesh.displacements(head.vertices, model.mean)
        length = np.linalg.norm(turned_with_lids(mesh, head, 0.5) - roots, axis=1)
        np.testing.assert_allclose(length, 0.5 * np.linalg.norm(mesh.mean - mesh.feet, axis=1), atol=2e-3)


def test_another_model_is_refused(model: MorphableModel) -> None:
    check_model(model)
    with pytest.raises(InputFileError, match=r"hair is bound to the built-in model .* found 'other'"):
        check_model(replace(model, name="other", sha256="0" * 64))
    with pytest.raises(InputFileError, match="with 4644"):
        check_model(builtin_model(0))
