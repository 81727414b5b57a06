"""Every script can be imported, and explains itself."""

import sys
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in sorted((ROOT / "scripts").rglob("*.py"))
    if path.name != "__init__.py"
]
COMMANDS = [
    name for name in MODULES if 'if __name__ == "__main__"' in (ROOT / f"{name.replace('.', '/')}.py").read_text()
]


@pytest.mark.parametrize("name", MODULES)
def test_a_script_can_be_imported(name: str) -> None:
    import_module(name)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_script_explains_itself(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as end:
        import_module(name).main()
    assert end.value.code == 0
    assert "usage: " in capsys.readouterr().out


def test_there_are_scripts_with_commands() -> None:
    assert len(COMMANDS) >= 10
