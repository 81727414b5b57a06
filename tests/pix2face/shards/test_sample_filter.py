from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pix2face.errors import UsageError
from pix2face.shards.sample_filter import SampleFilter

ATTRIBUTES = {"yaw_deg": -50.0, "light_kind": "studio", "focus_mm": 35.0}


def passes(text: str, attributes: dict | None = None) -> bool:
    return SampleFilter(text, "--where").passes("face-7", ATTRIBUTES if attributes is None else attributes)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("abs(yaw_deg) < 60 and light_kind != 'silhouette'", True),
        ("abs(yaw_deg) < 40", False),
        ("yaw_deg < -40", True),
        ("-60 < yaw_deg <= -50 < 0", True),
        ("not (yaw_deg > 0 or light_kind == 'studio')", False),
        ("light_kind in ('studio', 'night')", True),
        ("light_kind not in ['studio', 'night']", False),
        ("'stud' in light_kind", True),
        ("(yaw_deg + 10) * 2 / 4 - 1 == -21", True),
        ("max(yaw_deg, focus_mm, 3) == 35 and min(yaw_deg, 1) == -50", True),
        ("sample_id == 'face-7'", True),
        ("True and 1", True),
    ],
)
def test_conditions(text, expected):
    assert passes(text) == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("light_kind != 'night'", True),
        ("light_kind not in ('night',)", True),
        ("light_kind == 'night'", False),
        ("light_kind in ('night',)", False),
        ("abs(iso) < 100", False),
        ("not iso > 100", True),
        ("iso + 1 > 0 or 'x' in light_kind", False),
    ],
)
def test_what_is_not_there_equals_nothing(text, expected):
    assert passes(text, {"yaw_deg": 0.0}) == expected


LIT = {"light.kind": "studio", "light.key.share": 0.25, "skin.oil": 0.5, "yaw_deg": 3.0}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("light.kind == 'studio' and light.key.share < 0.5", True),
        ("light.kind in ('night', 'soft')", False),
        ("skin.stubble < 0.1 and skin.stubble == 0", True),
        ("abs(skin.stubble) > 0 or skin.stubble + 1 > 1", False),
        ("skin.marks != 0", False),
        ("light.key.angle <= 0", True),
        ("light.gobo.depth < 0.5 or light.gobo.depth == 0", False),
        ("hair.style != 'bald'", True),
        ("hair.style == 'bald' or hair.length >= 0", False),
        ("kind == 'studio' or ski.n >= 0", False),
    ],
)
def test_what_a_part_lacks_is_0_and_parts_that_are_not_there_are_nothing(text, expected):
    assert passes(text, LIT) == expected


def test_names_with_dots_that_no_sample_has_are_refused():
    found = SampleFilter("light.kind == 'studio' and skin.stubble < 0.1", "--where")
    found.passes("a", LIT)
    with pytest.raises(UsageError, match=r"among light\.key\.share, light\.kind, .*; found 'skin\.stubble'"):
        found.check_names()


def test_names_that_no_sample_has_are_refused_with_those_there_are():
    found = SampleFilter("abs(yaw) < 60 and focus_mm > 0", "--where")
    found.passes("a", ATTRIBUTES)
    found.passes("b", {"other": 1.0})
    with pytest.raises(
        UsageError, match=r"--where 'abs\(yaw\).*among focus_mm, light_kind, other, sample_id, yaw_deg; found 'yaw'"
    ):
        found.check_names()
    SampleFilter("sample_id != 'x'", "--where").check_names()


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('x')",
        "(lambda: 1)()",
        "yaw_deg.real() > 0",
        "(1).real > 0",
        "'text'.upper > 0",
        "light_kind[0] == 's'",
        "[x for x in light_kind]",
        "yaw_deg ** 9 ** 9 > 0",
        "open('x')",
        "abs(*light_kind)",
        "abs()",
        "yaw_deg if 1 else 2",
        "f'{yaw_deg}'",
        "(x := 1) > 0",
        "yaw_deg is 3",
        "b'bytes' == light_kind",
        "yaw_deg = 3",
        "yaw_deg <",
        "",
        "1 == 1\n2 == 2",
        "\0",
        "(" * 5000 + ")" * 5000,
        "not " * 3000 + "1",
        "x" * 20_000,
    ],
)
def test_anything_else_is_refused_in_one_line(text):
    with pytest.raises(UsageError, match=r"^--where .*expected") as caught:
        passes(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ["light_kind < 3", "yaw_deg / 0 > 1", "abs(light_kind) > 1", "3 in yaw_deg", "-light_kind > 0"]
)
def test_what_cannot_be_computed_names_the_sample(text):
    with pytest.raises(UsageError, match=r"cannot be said of 'face-7' with \{'"):
        passes(text)


@given(st.text(alphabet="abcxyz()<>=!+-*/'\" ,.[]{}0123456789andornotin_:\n\\", max_size=40))
def test_any_text_is_a_condition_or_refused(text):
    with suppress(UsageError):
        passes(text, {"a": 1.0, "x": "text"})
