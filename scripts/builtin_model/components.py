"""Computes principal components of heads and of expressions."""

from dataclasses import dataclass

import numpy as np
from numpy import ndarray

MIRRORED = np.array([-1.0, 1.0, 1.0])
# Expressions that need another one.
NEEDS = {"mouthClose": "jawOpen", "tongueOut": "jawOpen"}
MOST_ACTIVE = 5


@dataclass(frozen=True)
class Components:
    """A linear model."""

    mean: ndarray  # (v, 3)
    basis: ndarray  # (k, v, 3), per standard deviation
    variance_kept: float  # share of the variance of the face's vertices that the components explain


def align_rigidly(heads: ndarray, symmetry: ndarray, weights: ndarray, rounds: int = 3) -> ndarray:
    """Aligns every head rigidly with their symmetric mean, by weighted Procrustes without scale."""
    weights = weights / weights.sum()
    for _ in range(rounds):
        reference = _symmetric(heads.mean(axis=0), symmetry)
        centre = weights @ reference
        centres = np.einsum("v,nvc->nc", weights, heads)
        moments = np.einsum("v,nvc,vd->ncd", weights, heads - centres[:, None], reference - centre)
        u, _, vt = np.linalg.svd(moments)
        sign = np.sign(np.linalg.det(u @ vt))
        u[:, :, 2] *= sign[:, None]
        heads = (heads - centres[:, None]) @ (u @ vt) + centre
    return heads


def identity_components(heads: ndarray, symmetry: ndarray, weights: ndarray, n: int) -> Components:
    """Computes the components of aligned heads together with their mirror images.

    The mirror images make the mean symmetric, and each component symmetric or antisymmetric. Both kinds are computed
    separately.

    Args:
        heads: Aligned heads, (n, v, 3).
        symmetry: Mirror vertex of each vertex.
        weights: Weights of the vertices in the metric of the analysis.
        n: Number of components to keep.
    """
    mirrored = heads[:, symmetry] * MIRRORED
    mean = _symmetric(heads.mean(axis=0), symmetry)
    values, bases = [], []
    for part in ((heads + mirrored) / 2 - mean, (heads - mirrored) / 2):
        value, basis = _principal(part, weights, n)
        values.append(value)
        bases.append(basis)
    order = np.argsort(-np.concatenate(values))[:n]
    basis = np.concatenate(bases)[order]
    face = weights == weights.max()
    total = ((heads - mean)[:, face] ** 2).sum(axis=(1, 2)).mean()
    return Components(mean, basis, float((basis[:, face] ** 2).sum() / total))


def expression_components(
    expressions: dict[str, ndarray], weights: ndarray, n: int, seed: int
) -> tuple[Components, dict[str, ndarray], dict[str, float]]:
    """Computes the components of random mixtures of expressions, with the neutral face as mean.

    Returns:
        The components, the coefficients of each named expression, and the largest residual of each (in the unit of the
        input).
    """
    names = sorted(expressions)
    shapes = np.stack([expressions[name] for name in names])
    rng = np.random.default_rng(seed)
    mixtures = np.stack([_draw_mixture(rng, names) for _ in range(6000)])
    # Mixtures are linear in their weights, so the analysis needs no more than 52 dimensions.
    metric = np.repeat(np.sqrt(weights), 3)
    values, vectors = np.linalg.eigh(mixtures.T @ mixtures / len(mixtures))
    root = (vectors * np.sqrt(np.clip(values, 0, None))).T  # rows: uncorrelated mixtures of unit deviation
    u, _, _ = np.linalg.svd((root @ shapes.reshape(len(names), -1)) * metric, full_matrices=False)
    basis = np.einsum("mk,mj,jvc->kvc", u[:, :n], root, shapes)
    face = weights == weights.max()
    kept = float((basis[:, face] ** 2).sum() / (np.einsum("mj,jvc->mvc", root, shapes)[:, face] ** 2).sum())
    coefficients, residuals = {}, {}
    design = (basis.reshape(n, -1) * metric).T
    for name, shape in zip(names, shapes, strict=True):
        coefficients[name] = np.linalg.lstsq(design, shape.ravel() * metric, rcond=None)[0]
        left = shape - np.tensordot(coefficients[name], basis, axes=1)
        residuals[name] = float(np.linalg.norm(left[face], axis=1).max())
    return Components(np.zeros_like(shapes[0]), basis, kept), coefficients, residuals


def _draw_mixture(rng: np.random.Generator, names: list[str]) -> ndarray:
    """Draws strengths of expressions, with a few active groups, and both sides together or independent."""
    groups: dict[str, list[int]] = {}
    for index, name in enumerate(names):
        groups.setdefault(name.removesuffix("Left").removesuffix("Right"), []).append(index)
    weights = np.zeros(len(names))
    for group in rng.choice(sorted(groups), size=rng.integers(1, MOST_ACTIVE + 1), replace=False):
        strength = rng.uniform(0.1, 1.0)
        sides = (
            rng.uniform(0.7, 1.0, len(groups[group])) if rng.random() < 0.4 else rng.uniform(0, 1, len(groups[group]))
        )
        weights[groups[group]] = np.maximum(weights[groups[group]], strength * sides)
        if group in NEEDS:
            needed = names.index(NEEDS[group])
            weights[needed] = max(weights[needed], strength)
    return weights


def _principal(samples: ndarray, weights: ndarray, n: int) -> tuple[ndarray, ndarray]:
    """Returns eigenvalues in the weighted metric, and components per standard deviation in the unweighted one."""
    flat = samples.reshape(len(samples), -1)
    weighted = flat * np.repeat(np.sqrt(weights), 3)
    values, vectors = np.linalg.eigh(weighted @ weighted.T / len(flat))
    kept = np.argsort(-values)[:n]
    # Scores with unit deviation are sqrt(n) times the eigenvectors. A component is the displacement per deviation.
    basis = vectors[:, kept].T @ flat / np.sqrt(len(flat))
    return values[kept], basis.reshape(len(kept), -1, 3)


def _symmetric(mean: ndarray, symmetry: ndarray) -> ndarray:
    return (mean + mean[symmetry] * MIRRORED) / 2
