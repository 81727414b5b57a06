"""Faces in bins of what they were drawn from: by hand, and whatever the values are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.errors import UsageError
from pix2face.evaluation.attribute_bins import attribute_values, bin_names, errors_by_attribute
from pix2face.evaluation.benchmark_data import BenchmarkFace, BenchmarkItem
from pix2face.evaluation.bootstrap import Bootstrap

BOOTSTRAP = Bootstrap(200, 0)


def never() -> BenchmarkFace:
    raise AssertionError("attributes are known without reading a face")


def items(*attributes: dict[str, str | float]) -> list[BenchmarkItem]:
    return [BenchmarkItem(f"face-{index}", never, own) for index, own in enumerate(attributes)]


def test_numbers_lie_in_quarters_in_ascending_order():
    faces = items(*({"skin.melanin": tone} for tone in (0.8, 0.1, 0.5, 0.2, 0.7, 0.3, 0.4, 0.6)))
    errors = {f"face-{index}": error for index, error in enumerate((8, 1, 5, 2, 7, 3, 4, 6))}
    (values,) = attribute_values(["skin.melanin"], faces)
    bins = errors_by_attribute(values, errors, threshold=6.5, bootstrap=BOOTSTRAP).bins
    assert [own.name for own in bins] == ["0.1 to 0.275", "0.275 to 0.45", "0.45 to 0.625", "0.625 to 0.8"]
    assert [own.errors.mean for own in bins] == [1.5, 3.5, 5.5, 7.5]
    assert [own.errors.failure_rate for own in bins] == [0, 0, 0, 1]
    assert all(own.interval == (own.errors.mean - 0.5, own.errors.mean + 0.5) for own in bins)


def test_texts_lie_by_themselves_and_what_lacks_them_last():
    faces = items({"hat.kind": "cap"}, {"hat.kind": "beanie"}, {}, {"hat.kind": "cap"})
    errors = {"face-0": 0.1, "face-1": 0.2, "face-2": 0.3, "face-3": np.inf}
    (values,) = attribute_values(["hat.kind"], faces)
    found = errors_by_attribute(values, errors, 0.15, BOOTSTRAP)
    assert [(own.name, own.errors.n_images, own.errors.n_failed) for own in found.bins] == [
        ("beanie", 1, 0),
        ("cap", 2, 1),
        ("none", 1, 0),
    ]
    assert found.bins[1].errors.mean == 0.1
    assert found.bins[0].interval is None  # of one face there is nothing to draw


def test_conditions_and_sizes_are_computed():
    faces = items({"yaw_deg": -40.0}, {"yaw_deg": 10.0}, {"yaw_deg": 40.0})
    errors = {"face-0": 0.1, "face-1": 0.2, "face-2": 0.3}
    size, side = attribute_values(["abs(yaw_deg)", "yaw_deg > 0"], faces)
    assert dict(size.of_face) == {"face-0": 40, "face-1": 10, "face-2": 40}
    assert [own.name for own in errors_by_attribute(side, errors, 0.1, BOOTSTRAP).bins] == ["False", "True"]


def test_faces_that_were_not_evaluated_are_in_no_bin():
    (values,) = attribute_values(["tone"], items({"tone": 1.0}, {"tone": 2.0}))
    bins = errors_by_attribute(values, {"face-1": 0.2}, 0.1, BOOTSTRAP).bins
    assert [(own.name, own.errors.n_images) for own in bins] == [("2", 1)]
    assert errors_by_attribute(values, {}, 0.1, BOOTSTRAP).bins == ()


@pytest.mark.parametrize("text", ["tone", "tone +", "import os", "tone < 'a'"])
def test_what_cannot_be_said_of_the_faces_is_refused(text):
    with pytest.raises(UsageError, match="--by"):
        attribute_values([text], items({"skin.melanin": 1.0, **({"tone": 1.0} if "<" in text else {})}))


@given(st.lists(st.one_of(st.none(), st.booleans(), st.sampled_from("abc"), st.floats(-1e6, 1e6)), max_size=40))
def test_every_value_lies_in_a_bin_that_its_name_tells(values):
    for value, name in zip(values, bin_names(values), strict=True):
        if value is None:
            assert name == "none"
        elif isinstance(value, bool | str):
            assert name == str(value)
        else:
            low, _, high = name.partition(" to ")
            slack = 1e-2 * max(abs(float(low)), abs(float(high or low)))
            assert float(low) - slack <= value <= float(high or low) + slack
