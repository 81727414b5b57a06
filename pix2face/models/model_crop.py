"""Parts of models, such as a head without its neck: an index map on the vertices, nothing is computed anew."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from pix2face.errors import UsageError
from pix2face.geometry.landmarks import IBUG68
from pix2face.models.model_file import StoredModel


def crop_model(stored: StoredModel, kept_polygons: Bool[ndarray, " p"]) -> StoredModel:
    """Keeps some polygons of a model and the vertices that they use, in their order.

    A scheme of landmarks that loses a point is dropped, and so is the symmetry where a twin is lost. The model must be
    one without refinement, since refined landmarks have no place in its control mesh.

    Raises:
        UsageError: Nothing is kept, or the model is one that loading refines.
    """
    if not kept_polygons.any() or stored.refinement_steps:
        raise UsageError(
            f"expected at least one polygon to keep of a model without refinement, found {int(kept_polygons.sum())} "
            f"polygons and {stored.refinement_steps} refinement steps in {stored.name!r}"
        )
    polygons = stored.polygons[kept_polygons]
    kept = np.unique(polygons[polygons >= 0])
    new = np.full(len(stored.mean) + 1, -1, dtype=np.int32)  # the last entry stands for "no corner"
    new[kept] = np.arange(len(kept))
    landmarks = {scheme: new[vertices] for scheme, vertices in stored.landmarks.items()}
    landmarks = {scheme: vertices for scheme, vertices in landmarks.items() if (vertices >= 0).all()}
    symmetry = None if stored.symmetry is None else new[stored.symmetry[kept]]
    return replace(
        stored,
        mean=stored.mean[kept],
        identity_basis=np.ascontiguousarray(stored.identity_basis[:, kept]),
        expression_basis=np.ascontiguousarray(stored.expression_basis[:, kept]),
        polygons=new[polygons],
        polygon_regions=stored.polygon_regions[kept_polygons],
        uv_polygons=None if stored.uv_polygons is None else stored.uv_polygons[kept_polygons],
        symmetry=symmetry if symmetry is not None and (symmetry >= 0).all() else None,
        source_vertices=kept.astype(np.int32) if stored.source_vertices is None else stored.source_vertices[kept],
        landmarks=landmarks,
        approximate_landmarks=stored.approximate_landmarks if IBUG68 in landmarks else None,
        albedo_mean=None if stored.albedo_mean is None else stored.albedo_mean[kept],
        albedo_basis=None if stored.albedo_basis is None else np.ascontiguousarray(stored.albedo_basis[:, kept]),
    )


def without_regions(stored: StoredModel, *regions: str) -> StoredModel:
    """The model without the polygons of some regions (``neck``, ``scalp``, ...).

    Raises:
        UsageError: The model has no such region, or nothing would be left.
    """
    unknown = [region for region in regions if region not in stored.region_names]
    if unknown:
        raise UsageError(
            f"expected regions of {stored.name!r} ({', '.join(stored.region_names)}), found {', '.join(unknown)}"
        )
    dropped = [stored.region_names.index(region) for region in regions]
    return crop_model(stored, ~np.isin(stored.polygon_regions, dropped))
