"""Programs with commands: each is imported when it runs; errors become one line and an exit status."""

import importlib
import inspect
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, cast, final

import tyro
from threadpoolctl import threadpool_limits

from pix2face import __version__
from pix2face.command_line import EXIT_ERROR, printable
from pix2face.errors import Pix2FaceError, UsageError
from pix2face.files.writing import WRITE_ERRORS

EXIT_BROKEN_PIPE = 1
EXIT_INTERRUPTED = 130


@final
@dataclass(frozen=True)
class Command:
    """A command of a program.

    Attributes:
        options: A dataclass of options, whose docstring is the command's help; or a union of such dataclasses, one for
            each subcommand.
        function: The function that runs the command with its options and returns the exit status, or its place as
            "package.module:name". A place is imported when the command runs, so that help is quick.
        help: Help of the command, if its options are a union.
        default: From a command line to the options that it starts from. None: the defaults of the dataclass.
    """

    options: Any
    function: Callable[[Any], int] | str
    help: str = ""
    default: Callable[[Sequence[str]], Any] | None = None

    @property
    def description(self) -> str:
        """The help before the options."""
        return self.help or inspect.cleandoc(self.options.__doc__ or "").partition("\n\nAttributes:")[0]

    def reader(self, arguments: Sequence[str]) -> Callable[..., "Invocation"]:
        """What tyro calls with the options that it has read from a command line."""

        def read(options: Any) -> Invocation:
            return Invocation(self, options)

        reader: Any = inspect.unwrap(read)  # the tests wrap every function in checks of its types
        reader.__doc__ = self.description
        reader.__annotations__ = {"options": Annotated[self.options, tyro.conf.arg(name="")]}
        if self.default is not None:
            reader.__defaults__ = (self.default(arguments),)
        return cast("Callable[..., Invocation]", reader)


@final
@dataclass(frozen=True)
class Invocation:
    """A command with the options of one command line."""

    command: Command
    options: Any

    def run(self) -> int:
        """Imports and runs the command; returns its exit status.

        Raises:
            UsageError: It needs PyTorch, which is not installed.
        """
        try:
            return self._run()
        except ModuleNotFoundError as error:
            if error.name != "torch":
                raise
            raise UsageError("expected PyTorch, which training needs; run: pip install 'pix2face[train]'") from error

    def _run(self) -> int:
        function = self.command.function
        if isinstance(function, str):
            module, _, name = function.partition(":")
            function = getattr(importlib.import_module(module), name)
        # Fits solve systems of some hundred unknowns: threads of the linear algebra only wait for each other, and
        # beside any other job they make a solve up to a hundred times slower. Networks have threads of their own.
        with threadpool_limits(1, user_api="blas"):  # limits only what is loaded by now
            return function(self.options)


def run_commands(
    program: str, description: str, commands: Mapping[str, Command], arguments: Sequence[str] | None
) -> int:
    """Parses a command line with subcommands, runs the one chosen, and turns our errors into one line.

    Args:
        program: Name in messages.
        description: First lines of ``--help``.
        commands: The subcommands by name. A command under the name "" is what the program does where no subcommand is
            named.
        arguments: Without the program's name; None takes those of the process.

    Returns:
        The exit status: what the command returned, 2 on an error of ours, 130 when interrupted, 1 where nobody reads
        the output any more.
    """
    _replace_missing_streams()
    given = list(sys.argv[1:] if arguments is None else arguments)
    if "" in commands and given and given[0] in commands:
        chosen = commands[given[0]]
        return run_commands(f"{program} {given[0]}", _first_line(chosen), {"": chosen}, given[1:])
    try:
        status = _run(program, description, commands, given)
        sys.stdout.flush()  # else a failure to write the last lines would come too late to be said
        return status
    except BrokenPipeError:
        # As rich does where it prints. What is still to be written must not fail once more while Python ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_BROKEN_PIPE
    except (Pix2FaceError, OSError) as error:
        # OSError: no such right, no space, a file where a folder should be: what no command can foresee.
        sys.stderr.write(f"{program}: error: {printable(str(_with_its_place(error)))}\n")
        return EXIT_ERROR
    except MemoryError as error:
        found = f" ({printable(str(error))})" if str(error) else ""
        sys.stderr.write(f"{program}: error: more memory is needed than there is{found}; ask for less at a time\n")
        return EXIT_ERROR
    except KeyboardInterrupt:
        sys.stderr.write(f"{program}: interrupted; what was finished is kept\n")
        return EXIT_INTERRUPTED


def _with_its_place(error: Pix2FaceError | OSError) -> Pix2FaceError | OSError:
    """Names the standard output in the error of a failed write to it: errors of files name the file."""
    if isinstance(error, OSError) and error.filename is None and error.errno in WRITE_ERRORS:
        return OSError(error.errno, error.strerror, "standard output")
    return error


def _replace_missing_streams() -> None:
    """Drops what is printed where a program was started without a standard output or error."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 (until the process ends)


def _run(program: str, description: str, commands: Mapping[str, Command], arguments: list[str]) -> int:
    if arguments[:1] == ["--version"]:
        sys.stdout.write(f"{program} {__version__}\n")
        return 0
    named = {name: command for name, command in commands.items() if name}
    version = "" if " " in program else f"\n\n`{program} --version` prints the version."
    if "" not in commands:
        text = f"{description}\n\n`{program} COMMAND --help` explains a command.{version}"
        readers = {name: command.reader(arguments) for name, command in named.items()}
        return tyro.extras.subcommand_cli_from_dict(readers, prog=program, description=text, args=arguments).run()
    lines = [f"`{program} {name}`: {_first_line(command)}" for name, command in named.items()]
    subcommands = "\n\n" + "\n".join(["Subcommands, each with a `--help` of its own:", *lines]) if lines else ""
    text = f"{description}{subcommands}{version}"
    return tyro.cli(commands[""].reader(arguments), prog=program, description=text, args=arguments).run()


def _first_line(command: Command) -> str:
    return command.description.split("\n")[0]
