"""Runs programs with commands. A command is imported when it runs; errors become one line and an exit status."""

import importlib
import inspect
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from signal import SIGINT, SIGTERM
from typing import Annotated, Any, cast, final

import tyro
from threadpoolctl import threadpool_limits

from pix2face import __version__
from pix2face.command_line import EXIT_ERROR, printable
from pix2face.errors import WRITE_ERRORS, Pix2FaceError, UsageError
from pix2face.stop_signals import StoppedBySignal, exit_status_of, stopping_on_signals

EXIT_BROKEN_PIPE = 1


@final
@dataclass(frozen=True)
class Command:
    """A command of a program.

    Attributes:
        options: A dataclass of options, whose docstring is the command's help; or a union of such dataclasses, one for
            each subcommand.
        function: The function that runs the command with its options and returns the exit status, or its import path,
            "package.module:name", which is imported when the command runs, so that help is quick.
        help: Help of the command, if its options are a union.
        default: Takes the command line, and returns the default options. None: the defaults of the dataclass.
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
        """Returns the function that tyro calls with the options of a command line."""

        def read(options: Any) -> Invocation:
            return Invocation(self, options)

        reader: Any = inspect.unwrap(read)  # under pytest, every function is wrapped in type checks
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
            UsageError: The command needs PyTorch, which is not installed.
        """
        function = self.command.function
        try:
            if isinstance(function, str):
                module, _, name = function.partition(":")
                function = getattr(importlib.import_module(module), name)
            # Fits solve systems of some hundred unknowns. BLAS threads do not speed them up, and beside another job
            # they make them up to a hundred times slower. Networks have threads of their own.
            with threadpool_limits(1, user_api="blas"):  # limits only libraries that are already loaded
                return function(self.options)
        except ModuleNotFoundError as error:
            if error.name != "torch":
                raise
            raise UsageError("expected PyTorch, which training needs; run: pip install 'pix2face[train]'") from error


def run_commands(
    program: str, description: str, commands: Mapping[str, Command], arguments: Sequence[str] | None
) -> int:
    """Parses a command line, runs the command, and reports errors in one line.

    Args:
        program: Name of the program in messages.
        description: First lines of ``--help``.
        commands: The commands by name. The command "" is run if none is named.
        arguments: The command line without the program's name; None uses that of the process.

    Returns:
        The exit status: that of the command, 2 after an error, 130 after Ctrl-C, 143 after SIGTERM, and 1 if the output
        is a closed pipe.
    """
    _replace_missing_streams()
    given = list(sys.argv[1:] if arguments is None else arguments)
    if "" in commands and given and given[0] in commands:
        chosen = commands[given[0]]
        return run_commands(f"{program} {given[0]}", _first_line(chosen), {"": chosen}, given[1:])
    try:
        with stopping_on_signals([SIGTERM]):  # Python itself turns SIGINT into KeyboardInterrupt
            status = _run(program, description, commands, given)
        sys.stdout.flush()  # here, since an error at exit could not be reported
        return status
    except BrokenPipeError:
        # As rich does. Without it, writing the rest of the output would fail again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_BROKEN_PIPE
    except (Pix2FaceError, OSError) as error:
        # OSError: no permission, no space, or a file instead of a folder.
        sys.stderr.write(f"{program}: error: {printable(str(_with_its_place(error)))}\n")
        return EXIT_ERROR
    except MemoryError as error:
        found = f" ({printable(str(error))})" if str(error) else ""
        sys.stderr.write(f"{program}: error: more memory is needed than there is{found}; ask for less at a time\n")
        return EXIT_ERROR
    except (KeyboardInterrupt, StoppedBySignal) as stop:
        sys.stderr.write(f"{program}: interrupted; what was finished is kept\n")
        return exit_status_of(SIGINT) if isinstance(stop, KeyboardInterrupt) else stop.exit_status


def _with_its_place(error: Pix2FaceError | OSError) -> Pix2FaceError | OSError:
    """Adds "standard output" to the error of a failed write to it. Errors of files already name the file."""
    if isinstance(error, OSError) and error.filename is None and error.errno in WRITE_ERRORS:
        return OSError(error.errno, error.strerror, "standard output")
    return error


def _replace_missing_streams() -> None:
    """Discards output if the program was started without a standard output or error."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open("w", encoding="utf-8"))  # noqa: SIM115 (until the process ends)


def _run(program: str, description: str, commands: Mapping[str, Command], arguments: list[str]) -> int:
    if arguments[:1] == ["--version"]:
        sys.stdout.write(f"{program} {__version__}\n")
        return 0
    named = {name: command for name, command in commands.items() if name}
    if "" not in commands and arguments and arguments[0] not in named and os.path.exists(arguments[0]):  # noqa: PTH110 (never raises)
        raise UsageError(f"expected a command before {arguments[0]}: one of {', '.join(named)}")
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
