"""Every number of a configuration has limits, and is refused beyond them by the name that users know it by."""

import math
import re
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from datagen.appearance.appearance_config import DEFAULT, PRESETS, load_configuration
from datagen.config_limits import FromZero, Limits, Range, Share, check_limits, check_parts, check_weights
from pix2face.errors import InputFileError, UsageError

TABLES = [field.name for field in fields(PRESETS[DEFAULT]) if field.name != "preset"]
OPTIONS = [(table, field.name) for table in TABLES for field in fields(getattr(PRESETS[DEFAULT], table))]
SHARES = [(table, name) for table, name in OPTIONS if name.endswith("_share") or table == "accessories"]
LISTS = [(table, name) for table, name in OPTIONS if isinstance(getattr(getattr(PRESETS[DEFAULT], table), name), tuple)]


@dataclass(frozen=True)
class Lens:
    """A table with a field of each kind."""

    name: str = ""
    blur_share: Share = 0.5
    sharp_share: Share = 0.5
    noise: FromZero = 1.0
    focal_mm: Annotated[Range, Limits(0, 200, is_open=True)] = (20.0, 80.0)
    mixture: Annotated[tuple[float, float, float], Limits(0, 1, is_whole=True)] = (0.5, 0.2, 0.3)


def refuse_in_a_file(folder: Path, table: str, name: str, wrong: str) -> None:
    """Makes sure that a number is refused in each place of an option, which the message names."""
    path = folder / "own.toml"
    value = getattr(getattr(PRESETS[DEFAULT], table), name)
    numbers = list(map(str, value)) if isinstance(value, tuple) else [""]
    for place in range(len(numbers)):
        changed = [*numbers[:place], wrong, *numbers[place + 1 :]]
        text = f"[{', '.join(changed)}]" if isinstance(value, tuple) else wrong
        path.write_text(f"[{table}]\n{name} = {text}\n", encoding="utf-8")
        message = rf"^{re.escape(str(path))}: {table}\.{name}: expected .+, found .*{re.escape(wrong)}"
        with pytest.raises((UsageError, InputFileError), match=message):
            load_configuration(str(path))


@pytest.mark.parametrize("wrong", ["nan", "inf", "-1.0"])
@pytest.mark.parametrize(("table", "name"), OPTIONS)
def test_every_option_refuses_what_is_no_number_from_0(table: str, name: str, wrong: str, tmp_path: Path) -> None:
    refuse_in_a_file(tmp_path, table, name, wrong)


@pytest.mark.parametrize(("table", "name"), SHARES)
def test_every_share_refuses_more_than_everything(table: str, name: str, tmp_path: Path) -> None:
    refuse_in_a_file(tmp_path, table, name, "1.5")


@pytest.mark.parametrize(("table", "name"), LISTS)
def test_every_list_has_its_length(table: str, name: str) -> None:
    config = getattr(PRESETS[DEFAULT], table)
    value = getattr(config, name)
    for wrong in ((), value[:-1], (*value, value[-1]), value[0]):
        with pytest.raises(UsageError, match=rf"^{table}\.{name}: expected {len(value)} .*numbers"):
            check_limits(table, holding(config, name, wrong))


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("table", TABLES)
def test_presets_are_within_their_limits(preset: str, table: str) -> None:
    getattr(PRESETS[preset], table).check()


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("blur_share", 1.5, "lens.blur_share: expected a number from 0 to 1, found 1.5"),
        ("blur_share", (0.5,), "lens.blur_share: expected a number from 0 to 1, found [0.5]"),
        ("noise", math.nan, "lens.noise: expected a number from 0, found nan"),
        ("noise", math.inf, "lens.noise: expected a number from 0, found inf"),
        ("focal_mm", (0.0, 5.0), "lens.focal_mm: expected 2 ascending numbers above 0 to 200, found [0.0, 5.0]"),
        ("focal_mm", (6.0, 5.0), "lens.focal_mm: expected 2 ascending numbers above 0 to 200, found [6.0, 5.0]"),
        (
            "mixture",
            (0.5, 0.2, 0.2),
            "lens.mixture: expected 3 numbers from 0 to 1 that sum to 1, found [0.5, 0.2, 0.2]",
        ),
    ],
)
def test_a_refusal_says_what_was_expected_and_found(name: str, value: Any, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        check_limits("lens", holding(Lens(), name, value))
    assert str(caught.value) == message


def test_what_excludes_each_other_is_no_more_than_everything() -> None:
    check_parts("lens", Lens(), "blur_share", "sharp_share")
    with pytest.raises(
        UsageError, match=r"^lens\.blur_share: expected at most 1 together with sharp_share, found 1\.2$"
    ):
        check_parts("lens", Lens(blur_share=0.7), "blur_share", "sharp_share")


def test_something_has_a_weight() -> None:
    check_weights("lens", Lens(blur_share=0.0), "noise", "blur_share")
    with pytest.raises(
        UsageError, match=r"^lens\.noise: expected a number above 0 here or for blur_share, found none$"
    ):
        check_weights("lens", Lens(noise=0.0, blur_share=0.0), "noise", "blur_share")


@given(st.lists(st.floats(0, 10), min_size=1, max_size=5))
def test_limits_hold_what_ascends_between_them(numbers: list[float]) -> None:
    ascending = sorted(numbers)
    assert Limits(0, 10).hold(*ascending)
    assert Limits(ascending[0], ascending[-1]).hold(*ascending)
    assert not Limits(ascending[0], is_open=True).hold(*ascending)
    assert Limits(0, 10).hold(*numbers) == (numbers == ascending)
    total = sum(numbers)
    if total > 1e-3:
        assert Limits(0, 1, is_whole=True).hold(*(min(number / total, 1.0) for number in numbers))


def holding(config: Any, name: str, value: object) -> Any:
    """A copy with a value that its type may not allow."""
    changed = replace(config)
    object.__setattr__(changed, name, value)
    return changed
