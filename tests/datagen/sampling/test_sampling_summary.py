"""What drawn tables hold: the figures that docs/explanation/sampling.md quotes."""

from dataclasses import replace

import numpy as np
import pytest

from datagen.faces.coefficient_summary import summarise_table
from datagen.sampling.faces import sample_faces
from datagen.sampling.sampling_config import DEFAULT_GEOMETRY
from datagen.sampling.summary import drawn_shares
from pix2face.models.morphable_model import builtin_model
from tests.synthetic_models import small_head_model


def test_shares_are_counted_from_the_attributes() -> None:
    table = sample_faces(small_head_model(), 4, 0, 128)
    texts = (
        '{"distance_mm": 300, "expression": "emotion/joy", "named_expressions": "{\\"jawOpen\\":0.5}"}',
        '{"distance_mm": 3000, "expression": "emotion/fear", "named_expressions": "{\\"jawOpen\\":0.05}"}',
        '{"distance_mm": 5000, "expression": "neutral", "named_expressions": "{}"}',
        '{"distance_mm": 399, "expression": "neutral", "named_expressions": "{\\"tongueOut\\":0.1,\\"jawOpen\\":1}"}',
    )
    shares = drawn_shares(replace(table, attributes=texts), np.array([-50.0, 50.0, 3.0, 100.0]))
    assert shares["|yaw|"]["45..60°"] == 0.5
    assert shares["|yaw|"]["from 75°"] == 0.25
    assert shares["distance"]["0..400 mm"] == 0.5
    assert shares["distance"]["from 4500 mm"] == 0.25
    assert shares["expression"] == {"emotion": 0.5, "neutral": 0.5}
    assert shares["active (from 0.1)"] == {"jawOpen": 0.5, "tongueOut": 0.25}
    for name in ("|yaw|", "distance"):
        assert sum(shares[name].values()) == pytest.approx(1)


def test_drawn_tables_are_summed_up_and_others_are_too() -> None:
    drawn = summarise_table(sample_faces(builtin_model(), 200, 0, 128, DEFAULT_GEOMETRY)).drawn
    assert drawn.keys() == {"|yaw|", "distance", "expression", "active (from 0.1)"}
    assert sum(drawn["expression"].values()) == pytest.approx(1)
    assert drawn["|yaw|"]["45..60°"] + drawn["|yaw|"]["60..75°"] + drawn["|yaw|"]["from 75°"] > 0.25
    plain = sample_faces(small_head_model(), 5, 0, 128)
    assert summarise_table(plain).drawn.keys() == {"|yaw|"}
    assert summarise_table(replace(plain, attributes=())).drawn.keys() == {"|yaw|"}
