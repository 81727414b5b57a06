"""Errors of ours become one line and an exit status; names are printed as they stand."""

import io
import os
import signal
import sys
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from threadpoolctl import threadpool_info

from pix2face import programs
from pix2face.command_line import check_output_file, counted, prepare_output_folder, printable, progress_bar, say
from pix2face.errors import InputFileError, Pix2FaceError, UsageError
from pix2face.programs import Command, run_commands


@dataclass(frozen=True)
class CountConfig:
    """How far to count."""

    n: int = 1


COUNT = Command(CountConfig, lambda config: config.n)


def raising(error: BaseException) -> Command:
    def run_command(config: CountConfig) -> int:
        raise error

    return Command(CountConfig, run_command)


def run(command: Command, *arguments: str) -> int:
    return run_commands("program", "Does things.", {"": command}, arguments)


def test_the_status_is_what_the_command_returns() -> None:
    assert run(COUNT, "--n", "3") == 3
    assert run_commands("program", "", {"count": COUNT, "fail": raising(UsageError("no"))}, ["count", "--n", "7"]) == 7


def test_without_arguments_those_of_the_process_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["program", "--n", "5"])
    assert run_commands("program", "", {"": COUNT}, None) == 5


def test_an_error_of_ours_is_one_line_and_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(raising(Pix2FaceError("face.mat: expected 7 numbers, found 6"))) == 2
    captured = capsys.readouterr()
    assert captured.err == "program: error: face.mat: expected 7 numbers, found 6\n"
    assert captured.out == ""


def test_an_error_of_ours_cannot_grow_beyond_its_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(raising(InputFileError("two\nlines\x1b[2J.mat"))) == 2
    assert capsys.readouterr().err == "program: error: two\\nlines\\x1b[2J.mat\n"


def test_what_the_system_refuses_is_one_line_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(raising(PermissionError(13, "Permission denied", "out/face.json"))) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "Permission denied: 'out/face.json'" in error


@pytest.mark.parametrize("error", [MemoryError(), MemoryError("Unable to allocate 9. TiB\nfor an array")])
def test_too_little_memory_is_one_line_too(error: MemoryError, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(raising(error)) == 2
    said = capsys.readouterr().err
    assert said.startswith("program: error: more memory is needed than there is")
    assert said.count("\n") == 1


def test_an_error_that_is_a_bug_keeps_its_traceback() -> None:
    with pytest.raises(ZeroDivisionError):
        run(raising(ZeroDivisionError()))


def test_without_torch_the_line_that_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    (tmp_path / "trainer.py").write_text("import torch")
    monkeypatch.syspath_prepend(tmp_path)
    assert run(Command(CountConfig, "trainer:train")) == 2
    assert "expected PyTorch, which training needs; run: pip install 'pix2face[train]'" in capsys.readouterr().err
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        run(Command(CountConfig, "no_such_module:train"))


def terminated(config: CountConfig) -> int:
    os.kill(os.getpid(), signal.SIGTERM)
    return 0


@pytest.mark.parametrize(
    ("command", "status"), [(raising(KeyboardInterrupt()), 130), (Command(CountConfig, terminated), 143)]
)
def test_an_interruption_ends_a_command_in_one_line(
    command: Command, status: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(command) == status
    assert capsys.readouterr().err == "program: interrupted; what was finished is kept\n"


@pytest.mark.parametrize("arguments", [["--n", "many"], ["--no-such-option"], ["surplus"]])
def test_a_call_that_cannot_be_parsed_is_status_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        run(COUNT, *arguments)
    assert caught.value.code == 2


def test_a_reader_that_has_seen_enough_ends_a_program_quietly(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with open(writing, "w") as nobody:  # noqa: PTH123 (a descriptor)
        monkeypatch.setattr(sys, "stdout", nobody)
        assert run(COUNT, "--version") == 1
    assert capsys.readouterr().err == ""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full, which only Linux has")
def test_output_that_cannot_be_written_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    full = Path("/dev/full").open("w")  # noqa: SIM115 (closing it fails, too)
    monkeypatch.setattr(sys, "stdout", full)
    assert run(COUNT, "--version") == 2
    assert capsys.readouterr().err == "program: error: [Errno 28] No space left on device: 'standard output'\n"
    with suppress(OSError):
        full.close()


def test_a_program_needs_no_output_at_all(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdout", None)  # as Python has it after >&-
    monkeypatch.setattr(sys, "stderr", None)
    assert run(COUNT, "--version") == 0
    assert run(raising(UsageError("no"))) == 2
    for stream in (sys.stdout, sys.stderr):
        stream.close()


def test_linear_algebra_has_one_thread_while_a_command_runs() -> None:
    def threads(config: CountConfig) -> int:
        return max(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")

    assert run(Command(CountConfig, threads)) == 1


def test_a_command_is_imported_when_it_runs_and_before_linear_algebra_is_limited(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # What is loaded later would keep all its threads.
    events: list[str] = []
    later = Command(CountConfig, "some.module:function")
    monkeypatch.setattr(programs, "threadpool_limits", lambda *_, **__: events.append("limits") or nullcontext())
    loaded = SimpleNamespace(function=lambda config: config.n)
    monkeypatch.setattr(programs.importlib, "import_module", lambda name: events.append(name) or loaded)
    with pytest.raises(SystemExit):
        run(later, "--help")
    assert events == []
    assert run(later, "--n", "3") == 3
    assert events == ["some.module", "limits"]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain.jpg", "plain.jpg"),
        ("naïve 顔.jpg", "naïve 顔.jpg"),
        ("a\tb\nc\rd", "a\\tb\\nc\\rd"),
        ("\x1b[31m", "\\x1b[31m"),
        ("gpj.\u202eface", "gpj.\\u202eface"),  # turns the direction of writing
        ("caf\udce9", "caf\\udce9"),  # how Python holds a byte of a file name that is no UTF-8
    ],
)
def test_control_characters_become_visible(text: str, shown: str) -> None:
    assert printable(text) == shown


@given(st.text(st.characters(exclude_categories=())))
def test_whatever_is_printable_needs_no_second_pass(text: str) -> None:
    shown = printable(text)
    assert shown.isprintable()
    assert printable(shown) == shown
    shown.encode()


@pytest.mark.parametrize("name", ["[red]a[/red]", "[/]", "[link=x]y", ":smile:", "a\\[b]", "x" * 300, "1.5 'q' /p"])
def test_names_are_printed_as_they_stand(name: str) -> None:
    stream = io.StringIO()
    say(Console(file=stream, width=80, force_terminal=True), name)
    assert stream.getvalue() == f"{name}\n"


def test_progress_counts_up_to_the_total() -> None:
    stream = io.StringIO()
    with progress_bar(Console(file=stream, width=120), "faces", 3) as advance:
        advance()
        advance(2, note="last")
    assert "faces" in stream.getvalue()
    assert "3/3" in stream.getvalue()
    assert "last" in stream.getvalue()


def test_without_a_terminal_progress_is_a_line_from_time_to_time(monkeypatch: pytest.MonkeyPatch) -> None:
    stream, seconds = io.StringIO(), iter([0.0, 59.0, 61.0, 61.0, 100.0, 130.0, 130.0])
    monkeypatch.setattr("pix2face.command_line.monotonic", lambda: next(seconds))
    with progress_bar(Console(file=stream, width=120), "faces", 10) as advance:
        for _ in range(4):
            advance(2, note="warm")
        said = stream.getvalue().splitlines()
    assert said == ["faces: 4 of 10 warm", "faces: 8 of 10 warm"]


def test_a_folder_is_made_with_its_parents_and_one_that_is_there_is_left(tmp_path: Path) -> None:
    prepare_output_folder(tmp_path / "a" / "b")
    (tmp_path / "a" / "b" / "kept").touch()
    prepare_output_folder(tmp_path / "a" / "b")
    assert (tmp_path / "a" / "b" / "kept").exists()


def test_a_file_in_the_way_of_a_folder_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path / "file", tmp_path / "file" / "deep" / "er"):
        with pytest.raises(UsageError, match=r"can be written to, found that \S*/file is a file; choose another --out"):
            prepare_output_folder(path)


def test_a_name_that_is_too_long_is_our_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="found: File name too long; choose another --out"):
        prepare_output_folder(tmp_path / ("x" * 300) / "y")


def test_without_permission_nothing_is_begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda folder, mode: False)  # root may write everywhere
    with pytest.raises(UsageError, match=r"found no permission to write to .*; choose another --out"):
        prepare_output_folder(tmp_path)
    with pytest.raises(UsageError, match=r"faces\.h5: .*found no permission to write to .*; choose another --out"):
        check_output_file(tmp_path / "new" / "faces.h5", (".h5",))
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(("n", "text"), [(0, "0 shards"), (1, "1 shard"), (2, "2 shards")])
def test_numbers_agree_with_their_nouns(n: int, text: str) -> None:
    assert counted(n, "shard") == text


@pytest.mark.parametrize("name", ["faces.h5", "FACES.H5", "new/deep/faces.h5", "sheet.png"])
def test_a_file_that_can_be_written_is_let_through(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    check_output_file(tmp_path / name, (".h5", ".png"))
    check_output_file(Path(name), (".h5", ".png"))
    assert list(tmp_path.iterdir()) == []
