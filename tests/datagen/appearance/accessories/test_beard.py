from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from datagen.appearance.accessories.beard import (
    BEARD_STRANDS,
    COLUMNS,
    HEIGHT,
    LEVELS,
    ROWS,
    STYLES,
    WIDTH,
    Beard,
    beard_anchors,
    beard_layer,
    beard_meshes,
    beard_textures,
    draw_beard,
    style_densities,
)
from datagen.appearance.person import draw_person
from pix2face.models.morphable_model import builtin_model
from tests.datagen.appearance.accessories.heads import outside_mm, random_head

HAIR = (0.05, 0.03, 0.02)


def drawn(seed: int, style: str) -> Beard:
    rng = np.random.default_rng(seed)
    return replace(draw_beard(rng, draw_person(rng)), style=style)


def density_near(style: str, places: np.ndarray, within_mm: float) -> np.ndarray:
    """Largest density of a style within a distance of places of the mean head."""
    model = builtin_model()
    grid = beard_anchors(model).at(model.mean).reshape(ROWS, COLUMNS, 3)
    rows = np.linspace(0, ROWS - 1, HEIGHT // 2)
    columns = np.linspace(0, COLUMNS - 1, WIDTH // 2)
    r, c = np.minimum(rows.astype(int), ROWS - 2)[:, None], np.minimum(columns.astype(int), COLUMNS - 2)[None]
    down, along = (rows[:, None] - r)[..., None], (columns[None] - c)[..., None]
    upper = grid[r, c] * (1 - along) + grid[r, c + 1] * along
    lower = grid[r + 1, c] * (1 - along) + grid[r + 1, c + 1] * along
    points = (upper * (1 - down) + lower * down).reshape(-1, 3)
    density = style_densities()[style][::2, ::2].reshape(-1)
    return np.array([density[found].max(initial=0) for found in cKDTree(points).query_ball_point(places, within_mm)])


@pytest.mark.parametrize("style", STYLES)
def test_lips_stay_free(style: str) -> None:
    model = builtin_model()
    lips = model.vertices_of("lips")
    seen = model.mean[lips][model.mean[lips][:, 2] > 97]
    assert np.quantile(density_near(style, seen, 1.2), 0.97) < 0.25
    assert density_near(style, model.mean[model.landmarks["ibug68"][[30, 27, 36, 45]]], 4).max() == 0


def test_beards_grow_where_they_are_named_after() -> None:
    model = builtin_model()
    chin, above_lip = model.mean[model.landmarks["ibug68"][8]], np.array([[8.0, -29.0, 109.0]])
    assert density_near("full", chin[None], 4) > 0.9
    assert density_near("goatee", chin[None] + [0, 8, 8], 6) > 0.9
    assert density_near("moustache", above_lip, 4) > 0.9
    assert density_near("moustache", chin[None], 8) == 0
    assert density_near("strap", above_lip, 4) == 0


@pytest.mark.parametrize("seed", range(12))
def test_they_do_not_float(seed: int) -> None:
    head = random_head(seed)
    beard = drawn(seed, STYLES[seed % len(STYLES)])
    meshes = beard_meshes(beard, head, HAIR)
    regions = ("skin", "lips", "neck", "scalp", "brows")
    root, tips = (np.unique(mesh.triangles) for mesh in (meshes[0], meshes[-1]))
    assert np.abs(outside_mm(meshes[0].vertices[root], head, regions)).max() < 4
    assert np.median(np.abs(outside_mm(meshes[0].vertices[root], head, regions))) < 0.8
    reach = np.linalg.norm(meshes[-1].vertices[tips] - meshes[0].vertices[tips], axis=1)
    assert reach.max() <= beard.thickness_mm + 1.1 * beard.hang_mm + 0.1


def test_they_follow_the_jaw() -> None:
    model = builtin_model()
    closed = random_head(0)
    opened = replace(
        closed,
        vertices=model.vertices(
            np.zeros((1, model.n_identity)), model.named_expressions["jawOpen"][None].astype(np.float64)
        )[0],
    )
    beard = drawn(1, "full")
    before, after = (beard_meshes(beard, head, HAIR)[0].vertices for head in (closed, opened))
    assert (before[:, 1] - after[:, 1]).max() > 8


def test_layers_hold_strands() -> None:
    pixels = beard_textures()[BEARD_STRANDS].pixels
    assert len(pixels) == LEVELS * len(STYLES)
    assert pixels.nbytes < 8 << 20
    root, tip = pixels[beard_layer("full", 0), ..., 1], pixels[beard_layer("full", LEVELS - 1), ..., 1]
    assert root.mean() > 2 * tip.mean()
