"""Faces in bins of what they were drawn from: by hand, and whatever the values are."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.errors import UsageError
from pix2face.evaluation.benchmarks.benchmark_data import BenchmarkFace, BenchmarkItem
from pix2face.evaluation.figures.attribute_bins import NOT_THERE, attribute_values, divided, errors_by_attribute
from pix2face.evaluation.figures.bootstrap import Bootstrap

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
    assert [own.name for own in bins] == ["0.1 to 0.2", "0.3 to 0.4", "0.5 to 0.6", "0.7 to 0.8"]
    assert [own.errors.mean for own in bins] == [1.5, 3.5, 5.5, 7.5]
    assert [own.errors.failure_rate for own in bins] == [0, 0, 0, 1]
    assert all(own.interval == (own.errors.mean - 0.5, own.errors.mean + 0.5) for own in bins)


def test_texts_lie_by_themselves_and_what_lacks_them_last():
    faces = items({"hat.kind": "cap"}, {"hat.kind": "none"}, {}, {"hat.kind": "cap"})
    errors = {"face-0": 0.1, "face-1": 0.2, "face-2": 0.3, "face-3": np.inf}
    (values,) = attribute_values(["hat.kind"], faces)
    found = errors_by_attribute(values, errors, 0.15, BOOTSTRAP)
    assert [(own.name, own.errors.n_images, own.errors.n_failed) for own in found.bins] == [
        ("cap", 2, 1),
        ("none", 1, 0),
        (NOT_THERE, 1, 0),
    ]
    assert found.bins[0].errors.mean == 0.1
    assert found.bins[1].interval is None  # of one face there is nothing to draw


def test_conditions_and_sizes_are_computed():
    faces = items({"yaw_deg": -40.0}, {"yaw_deg": 10.0}, {"yaw_deg": 40.0})
    size, side = attribute_values(["abs(yaw_deg)", "yaw_deg > 0"], faces)
    assert dict(size.of_face) == {"face-0": 40, "face-1": 10, "face-2": 40}
    assert divided(list(side.of_face.values())) == [("False", [0]), ("True", [1, 2])]


def test_faces_that_were_not_evaluated_are_in_no_bin():
    (values,) = attribute_values(["tone"], items({"tone": 1.0}, {"tone": 2.0}))
    bins = errors_by_attribute(values, {"face-1": 0.2}, 0.1, BOOTSTRAP).bins
    assert [(own.name, own.errors.n_images) for own in bins] == [("2", 1)]
    assert errors_by_attribute(values, {}, 0.1, BOOTSTRAP).bins == ()


def test_a_number_that_most_faces_share_has_a_bin_of_its_own():
    """As strengths are stored: 0 where a thing is not worn, anything where it is."""
    strengths = [0.0] * 480 + np.linspace(0.1, 0.9, 120).tolist()
    (nothing, zeros), *others = divided(strengths)
    assert (nothing, len(zeros)) == ("0", 480)
    assert sum(len(own) for _, own in others) == 120


@pytest.mark.parametrize("share", [0.1, 0.25, 0.5, 0.75, 0.9])
def test_two_numbers_are_never_one_bin(share):
    n = round(400 * share)
    assert [(name, len(own)) for name, own in divided([1.0] * n + [0.0] * (400 - n))] == [("0", 400 - n), ("1", n)]


def test_names_have_the_digits_that_tell_bins_apart():
    assert [name for name, _ in divided([1000.1, 1000.2, 1000.3, 1000.4])] == ["1000.1", "1000.2", "1000.3", "1000.4"]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("tone", "expected attributes among"),
        ("tone +", "expected an expression"),
        ("import os", "expected an expression"),
        ("skin.melanin < 'a'", "cannot be said of"),
        ("[skin.melanin]", "expected a finite number, a text or a condition"),
        ("1e999 * skin.melanin", "expected a finite number"),
        ("skin.melanin - skin.melanin + 10000000000000000000000 * 1e999", "expected a finite number"),
        ("sample_id", "expected at most 50 different texts, found 60"),
    ],
)
def test_what_cannot_be_said_of_the_faces_is_refused(text, reason):
    with pytest.raises(UsageError, match=f"^--by .*{reason}"):
        attribute_values([text], items(*({"skin.melanin": 1.0} for _ in range(60))))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 10**400])
def test_a_shard_may_hold_any_number(value):
    with pytest.raises(UsageError, match="expected a finite number"):
        attribute_values(["tone"], items({"tone": value}))


@given(
    st.lists(
        st.one_of(
            st.none(),
            st.booleans(),
            st.sampled_from(["a", "2", "True", NOT_THERE]),
            st.floats(-9, 9).map(lambda x: round(x, 3) + 0.0),
        ),
        max_size=40,
    )
)
def test_every_value_lies_in_one_bin_beside_its_equals(values):
    bins = divided(values)
    assert sorted(index for _, own in bins for index in own) == list(range(len(values)))
    assert all(own for _, own in bins)
    assert len({name for name, _ in bins}) == len(bins)
    numbers = {value for value in values if isinstance(value, float)}
    n_of_numbers = sum(isinstance(values[own[0]], float) for _, own in bins)
    assert min(2, len(numbers)) <= n_of_numbers <= min(4, len(numbers))
    for _, own in bins:
        kinds = {(type(values[index]), None if isinstance(values[index], float) else values[index]) for index in own}
        assert len(kinds) == 1
    for number in numbers:
        of_number = [index for index, value in enumerate(values) if isinstance(value, float) and value == number]
        assert sum(not set(of_number).isdisjoint(own) for _, own in bins) == 1
