"""A quick share of what ``python -m tests.fuzz_model_formats`` does at length."""

from collections import Counter

import pytest

from tests.fuzz_model_formats import FORMATS, fuzz

CASES = 60


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.filterwarnings("default")
def test_damaged_files_are_read_or_refused(name: str) -> None:
    outcomes: Counter[str] = fuzz(name, CASES, seed=0)
    assert set(outcomes) <= {"read", "refused"}, outcomes
    assert outcomes["refused"] > CASES / 4
