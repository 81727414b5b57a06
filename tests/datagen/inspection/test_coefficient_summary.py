"""Tables of coefficients are counted by the engine that counts shards (docs/explanation/sampling.md quotes it)."""

from dataclasses import replace

import numpy as np

from datagen.inspection.coefficient_summary import summarise_table
from datagen.inspection.dataset_statistics import DatasetStatistics
from datagen.sampling.faces import sample_faces
from datagen.sampling.sampling_config import DEFAULT_GEOMETRY
from pix2face.models.morphable_model import builtin_model
from tests.synthetic_models import small_head_model

ACTIVE = "named_expressions, 0.1 or more"


def counts(found: DatasetStatistics, name: str) -> dict[str, int]:
    one = next(one for one in found.histograms if one.name == name)
    return {one.range_name(i, i): int(n) for i, n in enumerate(one.counts) if n}


def test_attributes_are_counted() -> None:
    table = sample_faces(small_head_model(), 4, 0, 128)
    texts = (
        '{"distance_mm": 300, "expression": "emotion/joy", "named_expressions": "{\\"jawOpen\\":0.5}"}',
        '{"distance_mm": 3000, "expression": "emotion/fear", "named_expressions": "{\\"jawOpen\\":0.05}"}',
        '{"distance_mm": 5000, "expression": "neutral", "named_expressions": "no object"}',
        '{"distance_mm": 399, "expression": "neutral", "named_expressions": "{\\"tongueOut\\":0.1,\\"jawOpen\\":1}"}',
    )
    found = summarise_table(replace(table, attributes=texts)).statistics
    assert counts(found, "distance") == {"0 to 400 mm": 2, "2500 to 4500 mm": 1, "4500 mm and more": 1}
    assert found.kinds["expression"] == {"neutral": 2, "emotion/joy": 1, "emotion/fear": 1}
    assert found.kinds["expression, kind"] == {"emotion": 2, "neutral": 2}
    assert found.kinds[ACTIVE] == {"jawOpen": 2, "tongueOut": 1}


def test_drawn_tables_say_what_was_drawn() -> None:
    table = sample_faces(builtin_model(), 200, 0, 128, DEFAULT_GEOMETRY)
    found = summarise_table(table).statistics
    assert sum(counts(found, "distance").values()) == sum(found.kinds["expression, kind"].values()) == 200
    assert 0 < found.kinds[ACTIVE]["jawOpen"] < 200
    identity = next(one for one in found.coefficients if one.name == "identity")
    np.testing.assert_allclose(identity.rms, np.sqrt((table.identity.astype(np.float64) ** 2).mean(axis=0)))
    yaw = next(one for one in found.histograms if one.name == "yaw")
    assert yaw.counts[(yaw.edges[:-1] >= 45) | (yaw.edges[1:] <= -45)].sum() > 0.25 * 200


def test_tables_without_attributes_have_poses() -> None:
    table = sample_faces(small_head_model(), 5, 0, 128)
    for changed in (table, replace(table, attributes=())):
        found = summarise_table(changed).statistics
        assert [one.name for one in found.histograms] == ["pitch", "yaw", "roll"]
        assert found.picture_sizes == {"128 x 128": 5}
