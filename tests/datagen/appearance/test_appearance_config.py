"""Configurations: what is printed reads back, and what makes no sense is named."""

import json
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from datagen.appearance.appearance import appearance_attributes, draw_appearance
from datagen.appearance.appearance_config import DEFAULT, HARD, PLAIN, PRESETS, load_configuration, to_toml
from datagen.cli import main
from pix2face.errors import InputFileError, UsageError
from pix2face.shards.sample_filter import SampleFilter
from pix2face.shards.shard_writing import LARGEST_TEXT_BYTES


@pytest.mark.parametrize("name", PRESETS)
def test_what_the_command_prints_is_a_configuration(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["appearance", name]) == 0
    text = capsys.readouterr().out
    (tmp_path / "printed.toml").write_text(text)
    assert load_configuration(str(tmp_path / "printed.toml")) == PRESETS[name]
    assert max(map(len, text.splitlines())) <= 120


def test_every_number_is_explained() -> None:
    lines = to_toml(PRESETS[DEFAULT]).splitlines()
    bare = [line for above, line in pairwise(lines) if "=" in line and above[:1] != "#"]
    assert bare == []


def test_a_file_changes_what_it_names_and_starts_from_its_preset(tmp_path: Path) -> None:
    path = tmp_path / "own.toml"
    path.write_text('preset = "hard"\n[geometry]\nroll_deg = 5\n')
    expected = replace(PRESETS[HARD], geometry=replace(PRESETS[HARD].geometry, roll_deg=5.0))
    assert load_configuration(str(path)) == expected
    described = expected.described()
    assert described["appearance"] == HARD
    assert described["appearance.geometry.roll_deg"] == 5
    assert described["appearance_sha256"] != PRESETS[HARD].described()["appearance_sha256"]
    assert [name for name in described if name.startswith("appearance.")] == ["appearance.geometry.roll_deg"]


def test_presets_say_no_more_than_their_name_and_hash() -> None:
    assert PRESETS[PLAIN].described() == {"appearance": PLAIN}
    assert set(PRESETS[DEFAULT].described()) == {"appearance", "appearance_sha256"}


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        ("[geometry]\nrol = 5", InputFileError, r"geometry\.rol: expected one of is_plain, .*, found 'rol'"),
        ("[weather]\nrain = 5", InputFileError, "weather: expected one of preset, geometry, .*, found 'weather'"),
        ('[geometry]\nroll_deg = "much"', InputFileError, r"geometry\.roll_deg: expected a number such as .*'much'"),
        (
            "[geometry]\nwide_yaw_deg = [1.0]",
            InputFileError,
            r"geometry\.wide_yaw_deg: expected 2 values, found \[1\.0\]",
        ),
        ("geometry = 3", InputFileError, "geometry: expected a table, found 3"),
        ('preset = "softer"', UsageError, "preset: expected plain, default, hard, found 'softer'"),
        (
            "[geometry]\nturned_share = 1.5",
            UsageError,
            r"geometry\.turned_share: expected a number from 0 to 1, found 1\.5",
        ),
        ("= 3", InputFileError, "expected a TOML file"),
    ],
)
def test_mistakes_are_named(text: str, error: type[Exception], message: str, tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(error, match=message) as caught:
        load_configuration(str(path))
    assert str(path) in str(caught.value)


def test_neither_preset_nor_file() -> None:
    with pytest.raises(UsageError, match="expected plain, default, hard or a TOML file, found 'nowhere'"):
        load_configuration("nowhere")


def test_parts_do_not_depend_on_each_other() -> None:
    other = replace(PRESETS[DEFAULT], light=PRESETS[HARD].light)
    for name in ("a", "b", "c"):
        first, second = draw_appearance(0, name, PRESETS[DEFAULT]), draw_appearance(0, name, other)
        assert (first.skin, first.hair, first.accessories) == (second.skin, second.hair, second.accessories)
        assert first.photograph == second.photograph
        assert first == draw_appearance(0, name, PRESETS[DEFAULT])
        assert first != draw_appearance(1, name, PRESETS[DEFAULT])


def test_an_appearance_is_stored_with_room_to_spare() -> None:
    for number in range(50):
        attributes = appearance_attributes(draw_appearance(0, f"{number}", PRESETS[HARD]))
        assert all(isinstance(value, str | float) for value in attributes.values())
        assert len(json.dumps(attributes)) < LARGEST_TEXT_BYTES["attributes"] / 3
        assert attributes["light.kind"]
        assert 0 <= float(attributes.get("person.melanin", 0)) <= 1


def test_attributes_say_what_is_not_0() -> None:
    sizes = []
    for number in range(40):
        appearance = draw_appearance(0, f"{number}", PRESETS[DEFAULT])
        attributes = appearance_attributes(appearance)
        sizes.append(len(json.dumps(attributes, separators=(",", ":"))))
        filtered = {
            "skin.stubble": appearance.skin.stubble,
            "skin.marks": len(appearance.skin.marks),
            "hair.hairdo.is_mirrored": appearance.hair.hairdo.is_mirrored,
            "photograph.tone.contrast": appearance.photograph.tone.contrast,
        }
        for name, value in filtered.items():
            assert attributes.get(name, 0) == pytest.approx(float(value), rel=1e-3)
            assert (name in attributes) == bool(value)
        has_glasses = any(name.startswith("accessories.glasses.") for name in attributes)
        assert has_glasses == (appearance.accessories.glasses is not None)
        for part in vars(appearance):
            assert any(name.startswith(f"{part}.") for name in attributes), part
        assert SampleFilter("skin.stubble >= 0 and skin.vitiligo < 2", "--where").passes("a", attributes)
    assert sum(sizes) / len(sizes) < 3400


@pytest.mark.parametrize("value", ["[1, 2]", "{a = 1}", "5", "'none'"])
def test_a_preset_that_is_none_is_refused(tmp_path: Path, value: str) -> None:
    (tmp_path / "a.toml").write_text(f"preset = {value}\n")
    with pytest.raises(UsageError, match=r"a\.toml: preset: expected"):
        load_configuration(str(tmp_path / "a.toml"))
