"""The small synthetic head as a model file, for what opens models by path."""

from pathlib import Path

import numpy as np

from pix2face.models.model_file import StoredModel, write_stored_model
from pix2face.models.morphable_model import MorphableModel
from tests.synthetic_models import small_head_model


def stored_small_head() -> StoredModel:
    """The small head as its file holds it: triangles, no refinement."""
    model: MorphableModel = small_head_model()
    none = np.full(len(model.triangles), -1, dtype=np.int32)
    return StoredModel(
        name=model.name,
        licence=model.licence,
        origin=model.origin,
        mean=model.mean,
        identity_basis=model.identity_basis,
        expression_basis=model.expression_basis,
        polygons=np.column_stack([model.triangles, none]),
        polygon_regions=model.triangle_regions,
        region_names=model.region_names,
        face_regions=model.face_regions,
        landmarks=model.landmarks,
        symmetry=model.symmetry,
        named_expressions=model.named_expressions,
    )


def write_small_head(path: Path) -> Path:
    """Writes the small head and returns the path."""
    write_stored_model(stored_small_head(), path)
    return path
