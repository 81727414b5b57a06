"""Names mean the face that they tell apart, and nothing where they do not."""

import pytest

from pix2face.errors import UsageError
from pix2face.evaluation.benchmarks.benchmark_search import match_names

KNOWN = ["helen/1_1.jpg", "lfpw/image_0001.png", "401/000001", "402/000001"]


@pytest.mark.parametrize("name", ["helen/1_1.jpg", "helen/1_1", "1_1.jpg", "1_1"])
def test_a_name_may_be_short(name):
    assert match_names([name], KNOWN, "split") == {"helen/1_1.jpg": 0}


def test_frames_need_their_clip():
    assert match_names(["402/000001", "401/000001"], KNOWN, "split") == {"402/000001": 0, "401/000001": 1}
    with pytest.raises(UsageError, match="'000001', which may be '401/000001' or '402/000001'; give it in full"):
        match_names(["000001"], KNOWN, "split")


def test_unknown_names_and_two_for_one_are_refused():
    with pytest.raises(
        UsageError, match=r"expected names of split such as 'helen/1_1.jpg' or '1_1', found 'x', 'y', 'z' and 1 more"
    ):
        match_names(["1_1", "x", "y", "z", "w"], KNOWN, "split")
    with pytest.raises(UsageError, match=r"'helen/1_1.jpg' as '1_1' and as '1_1.jpg'"):
        match_names(["1_1", "1_1.jpg"], KNOWN, "split")


def test_a_full_name_is_never_taken_for_a_short_one():
    assert match_names(["a"], ["a", "b/a"], "split") == {"a": 0}
