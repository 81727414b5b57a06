"""JSON is read into the type that it should have, or refused in words."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from pix2face.errors import InputFileError
from pix2face.files.json_text import Integer, JsonObject, Positive, parse_json, read_json_file


@dataclass(frozen=True)
class Header:
    name: str
    scale: Positive
    sizes: tuple[Integer, ...] = ()


def test_json_becomes_what_it_should_be() -> None:
    text = '{"name": "caf\\udce9", "scale": 3, "sizes": [1, 2], "other": null}'
    assert parse_json(text, Header) == Header("caf\udce9", 3.0, (1, 2))
    assert parse_json(text.encode(), JsonObject) == json.loads(text)
    assert parse_json('{"a": NaN}', dict[str, float], must_be_finite=False)["a"] != 0


@pytest.mark.parametrize(
    ("text", "kind", "found"),
    [
        ("", JsonObject, "Expecting value"),
        (b"\xff", JsonObject, "can't decode"),
        ("[]", JsonObject, "Expected `object`, got `array`"),
        ("null", Header, "Expected `object`, got `null`"),
        ('{"a": NaN}', JsonObject, "NaN is not finite"),
        ('{"a": -Infinity}', JsonObject, "-Infinity is not finite"),
        ('{"a": 1e999}', JsonObject, "1e999 is not finite"),
        ('{"name": "a", "scale": 0}', Header, "Expected `float` > 0.0 - at `$.scale`"),
        ('{"name": "a", "scale": "1"}', Header, "Expected `float`, got `str` - at `$.scale`"),
        ('{"name": "a", "scale": 1' + "0" * 400 + "}", Header, "out of range"),
        ('{"name": "a", "scale": 1, "sizes": [1.5]}', Header, "Expected `int`, got `float` - at `$.sizes[0]`"),
        ('{"name": "a", "scale": 1, "sizes": [1' + "0" * 400 + "]}", Header, "Expected `int` <= "),
        ('{"name": 3, "scale": 1}', Header, "Expected `str`, got `int` - at `$.name`"),
        ('{"scale": 1}', Header, "missing required field `name`"),
        ('{"a": 1' + "0" * 5000 + "}", JsonObject, "4300 digits"),
        ('{"a":' * 33 + "1" + "}" * 33, JsonObject, "more than 32 levels"),
        ("[" * 100_000, JsonObject, "more than 32 levels"),
        ("[" + "[]," * 8_000_000 + "1]", JsonObject, "16000001 values, where at most 8000000 are read"),
    ],
)
def test_other_json_is_refused(text: str | bytes, kind: Any, found: str) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011 (the text is compared)
        parse_json(text, kind)
    assert found in str(caught.value)


def test_files_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text('\ufeff{"a": 1}', encoding="utf-8")
    assert read_json_file(tmp_path / "a.json", JsonObject, "a report", 100) == {"a": 1}
    with pytest.raises(InputFileError, match=r"a\.json: expected a report, found something else \(Expected `array`"):
        read_json_file(tmp_path / "a.json", list[int], "a report", 100)
