"""Transparent meshes cast shadows where they are opaque enough."""

import numpy as np
import pytest
from numpy import ndarray

from datagen.rendering.processor.nearest import NOWHERE, draw_nearest
from datagen.rendering.processor.opaque_parts import draw_opaque_parts

SIZE = 16
OPAQUE = np.array([[[0.5, 1.0]]], dtype=np.float32)
UNCUT = (1e6, -1e6)
SQUARE = np.array([[0, 0, 1], [SIZE, 0, 1], [SIZE, SIZE, 1], [0, SIZE, 1]], dtype=np.float32)
SQUARE_UV = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)


def drawn(
    points: ndarray,
    triangles: list | ndarray,
    texture: ndarray = OPAQUE,
    uv: ndarray | None = None,
    above_and_within: tuple[float, float] = UNCUT,
    opacity: tuple[float, float] = (1.0, 0.5),
) -> ndarray:
    surface = np.zeros((len(points), 4), dtype=np.float32)
    surface[:, :2] = 0.5 if uv is None else uv
    surface[:, 2:] = above_and_within
    nearest = np.full((SIZE, SIZE), np.inf, np.float32)
    draw_opaque_parts(points, np.array(triangles, np.int32), surface, texture, opacity, nearest)
    return nearest


def square(texture: ndarray = OPAQUE, **options: tuple[float, float]) -> ndarray:
    """Where a square over the whole map is drawn."""
    return np.isfinite(drawn(SQUARE, [[0, 1, 2], [0, 2, 3]], texture, SQUARE_UV, **options))


def test_what_is_opaque_everywhere_is_drawn_as_any_mesh() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-4, SIZE + 4, (90, 3)).astype(np.float32)
    triangles = np.arange(90, dtype=np.int32).reshape(-1, 3)
    expected = np.full((SIZE, SIZE), np.inf, np.float32)
    draw_nearest(points, triangles, 0.0, NOWHERE, (1.0, 0.0), expected, np.zeros_like(expected))
    np.testing.assert_allclose(drawn(points, triangles), expected, rtol=1e-4, atol=1e-3)


def test_a_texture_says_where() -> None:
    alpha = np.repeat([[0.0, 0.0, 1.0, 1.0]], 4, axis=0)
    found = square(np.stack([np.full_like(alpha, 0.5), alpha], axis=2).astype(np.float32))
    # The texture repeats: half a texel at each side is mixed with the other side.
    assert found[:, 9:14].all()
    assert not found[:, 2:7].any()


@pytest.mark.parametrize(("alpha", "is_drawn"), [(0.45, False), (0.55, True)])
def test_what_is_less_opaque_than_asked_for_is_left_out(alpha: float, is_drawn: bool) -> None:
    assert square(np.array([[[0.5, alpha]]], dtype=np.float32)).all() == is_drawn


def test_sparse_hair_is_less_opaque() -> None:
    assert not square(opacity=(0.4, 0.5)).any()


def test_hair_is_cut_and_thin_at_the_crown() -> None:
    assert not square(above_and_within=(-9.0, -1e6)).any()
    assert not square(above_and_within=(1e6, 20.0)).any()
    assert square(above_and_within=(9.0, -50.0)).all()
