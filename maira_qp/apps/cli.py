"""The command line: `maira-qp` and `python -m maira_qp`."""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Sequence
from typing import Any, Union, get_args

import tyro

import maira_qp
from maira_qp.apps.arguments.naming import in_flags
from maira_qp.apps.arguments.optional import command, explain_flags
from maira_qp.apps.commands.bench import Bench
from maira_qp.apps.commands.cache import Cache
from maira_qp.apps.commands.compare import Compare
from maira_qp.apps.commands.compile import Compile
from maira_qp.apps.commands.doctor import Doctor
from maira_qp.apps.commands.fk import Fk
from maira_qp.apps.commands.jobs.dataset import Dataset
from maira_qp.apps.commands.jobs.job import Job, JobActions
from maira_qp.apps.commands.jobs.place import Place
from maira_qp.apps.commands.jobs.reach import Reach
from maira_qp.apps.commands.plot import Pictures, Plot
from maira_qp.apps.commands.robots import Robots
from maira_qp.apps.commands.solve import Solve
from maira_qp.apps.commands.track import Track
from maira_qp.apps.commands.urdf import Urdf
from maira_qp.apps.commands.view import View
from maira_qp.apps.interrupts import Terminated, interruptible
from maira_qp.apps.left_pipes import drop_output, reader_may_leave, replace_closed_streams
from maira_qp.apps.overview import print_details, print_overview
from maira_qp.errors import MairaError, OptionError, listed

MISUSE = 2
INTERRUPTED = 130
PIPE_CLOSED = 141
HELP = {"-h", "--help"}

COMMANDS: dict[str, type] = {
    "solve": Solve,
    "track": Track,
    "fk": Fk,
    "robots": Robots,
    "view": View,
    "plot": Plot,
    "urdf": Urdf,
    "reach": Reach,
    "place": Place,
    "dataset": Dataset,
    "job": Job,
    "compare": Compare,
    "bench": Bench,
    "doctor": Doctor,
    "compile": Compile,
    "cache": Cache,
}
Command: Any = Union[tuple(command(kind, name) for name, kind in COMMANDS.items())]  # noqa: UP007


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a command and returns its exit code; `arguments` None: those of the process."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    replace_closed_streams()
    try:
        with interruptible():
            code = _run(arguments)
            sys.stdout.flush()
        return code
    except BrokenPipeError:
        drop_output()
        return 0 if HELP & set(arguments) else PIPE_CLOSED
    except Terminated as end:
        print("maira-qp: terminated", file=sys.stderr)  # noqa: T201
        return end.code
    except KeyboardInterrupt:
        print("maira-qp: interrupted", file=sys.stderr)  # noqa: T201
        return INTERRUPTED


def _run(arguments: list[str]) -> int:
    if arguments == ["--version"]:
        sys.stdout.write(f"maira-qp {maira_qp.__version__}\n")
        return 0
    if arguments in (["--help"], ["-h"], []):  # who names no command is shown them all
        with reader_may_leave():
            print_overview(COMMANDS, sys.stdout if arguments else sys.stderr)
        return 0 if arguments else MISUSE
    if arguments in (["plot"], ["job"]):
        with contextlib.redirect_stdout(sys.stderr):
            _run([*arguments, "--help"])
        return MISUSE
    try:
        return parse(arguments).run()
    except BrokenPipeError:
        raise
    except (MairaError, OSError) as reason:
        told = in_flags(_words(reason), arguments)
        print(f"maira-qp: error: {' '.join(told.split())}", file=sys.stderr)  # noqa: T201
        return MISUSE
    except SystemExit as end:  # help or completions (0, None), or what cannot be parsed (2), was printed
        return MISUSE if isinstance(end.code, str) else end.code or 0


def _words(reason: MairaError | OSError) -> str:
    """What went wrong, in words of the command line."""
    if isinstance(reason, MairaError):
        return reason.for_shell
    return str(reason) if reason.filename is None else f"{reason.strerror}: {str(reason.filename)!r}"


def parse(arguments: list[str]) -> Any:
    """The command with its flags. Raises `MairaError` for a bad value, `SystemExit` after help or a bad flag."""
    _check_word(arguments[:1], "command", Command)
    if arguments[:1] == ["plot"]:
        _check_word(arguments[1:2], "picture", Pictures)
    if arguments[:1] == ["job"]:
        _check_word(arguments[1:2], "action", JobActions)
    if HELP & set(arguments):
        explain_flags()
    told = io.StringIO()
    try:
        with contextlib.redirect_stderr(told):
            return tyro.cli(Command, args=arguments, prog="maira-qp", config=(tyro.conf.DisallowNone,))
    except SystemExit as end:
        if not end.code and HELP & set(arguments):
            print_details(_kind(arguments))
        reason: BaseException | None = end
        while reason is not None:  # tyro wraps what a class of flags raises: its own words say it better
            if isinstance(reason, MairaError):
                raise reason from None
            reason = reason.__context__
        sys.stderr.write(told.getvalue())
        raise


def _kind(arguments: list[str]) -> type:
    """The class of the command that arguments begin with."""
    kind = COMMANDS[arguments[0]]
    pictures_or_actions = {"plot": Pictures, "job": JobActions}.get(arguments[0])
    for member in get_args(pictures_or_actions):
        if get_args(member)[1].name in arguments[1:2]:
            return get_args(member)[0]  # type: ignore[no-any-return]
    return kind


def _check_word(words: list[str], kind: str, union: Any) -> None:
    """Raises `OptionError` for a word, if there is one, that is no flag and names no member of a union of commands."""
    names = [get_args(member)[1].name for member in get_args(union)]
    for word in words:
        if not word.startswith("-") and word not in names:
            raise OptionError(f"no {kind} {word!r}; {listed(names, word)}")
