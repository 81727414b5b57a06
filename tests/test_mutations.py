"""The mistakes of ``python -m tests.mutations`` still apply to the code; the command tells noticed from survived."""

from pathlib import Path

import pytest

from tests.mutations import __main__ as mutations
from tests.mutations.mistakes import MISTAKES, Mistake

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.name)
def test_mistake_applies_at_one_place_and_leaves_python(mistake: Mistake) -> None:
    path = mutations.place_of(mistake)
    text = path.read_text(encoding="utf-8")
    assert mistake.after not in ("", mistake.before)
    compile(text.replace(mistake.before, mistake.after), str(path), "exec")
    assert (ROOT / mistake.tests).exists()


def test_there_are_enough_with_names_of_their_own() -> None:
    assert len({mistake.name for mistake in MISTAKES}) == len(MISTAKES) >= 40


def test_noticed_and_surviving_mistakes_are_told_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")  # plugins take longer to load than the tests to run
    (tmp_path / "area.py").write_text("def area(w, h):\n    return w * h  # right\n")
    (tmp_path / "test_area.py").write_text("from area import area\n\ndef test_it():\n    assert area(2, 3) == 6\n")
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    noticed = Mistake("sum", "", "w * h", "w + h", "test_area.py")
    unnoticed = Mistake("comment", "", "# right", "# wrong", "test_area.py")
    assert not mutations.survives(noticed, tmp_path)
    assert mutations.survives(unnoticed, tmp_path)


def test_text_that_is_gone_is_an_error() -> None:
    with pytest.raises(LookupError, match="found 0"):
        mutations.place_of(Mistake("gone", "pix2face/geometry", "no such text", "x", "tests"))
