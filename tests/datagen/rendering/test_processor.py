"""What is compiled: where it is kept, and what the first start says."""

from pathlib import Path
from types import SimpleNamespace

import numba
import pytest

from datagen.rendering.processor import compiling, processor_maps
from datagen.rendering.processor.compiling import CACHE_VARIABLE, compiled, private_folder
from datagen.rendering.processor.processor_maps import prepare
from tests.synthetic_models import small_head_model


def test_a_private_folder_serves_where_no_other_can_be_written_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused = []

    def njit(**options: object) -> object:
        def compile_later(function: object) -> object:
            if not refused:
                refused.append(function)
                raise RuntimeError("cannot cache function: no locator available")
            return numba.njit(**options)(function)

        return compile_later

    def double(x: int) -> int:
        return 2 * x

    monkeypatch.setattr(compiling, "numba", SimpleNamespace(njit=njit))
    monkeypatch.setattr(compiling.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setenv(CACHE_VARIABLE, "")
    assert compiled(double)(4) == 8
    (folder,) = tmp_path.iterdir()
    assert compiling.os.environ[CACHE_VARIABLE] == str(folder)
    assert list(folder.rglob("*.nbc")) != []


def test_what_others_can_write_to_is_never_run(tmp_path: Path) -> None:
    folder = private_folder(tmp_path)
    assert private_folder(tmp_path) == folder
    assert folder.stat().st_mode & 0o077 == 0
    folder.chmod(0o777)
    assert private_folder(tmp_path) != folder
    folder.rmdir()
    folder.symlink_to(tmp_path)
    assert private_folder(tmp_path) != folder


@pytest.mark.parametrize(("within_s", "says"), [(0.0, True), (600.0, False)])
def test_a_start_that_takes_longer_says_so(monkeypatch: pytest.MonkeyPatch, within_s: float, says: bool) -> None:
    said: list[bool] = []
    monkeypatch.setattr(processor_maps, "LOADED_WITHIN_S", within_s)
    prepare(small_head_model(), (), lambda: said.append(True))
    assert bool(said) == says
