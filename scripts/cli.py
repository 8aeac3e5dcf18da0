"""The console command `endolock`: one sub-command per script, one line per error."""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields
from typing import Annotated, Any, Union, get_origin, get_type_hints

import endolock
from endolock.hw.errors import (
    ConfigError,
    DamageWarning,
    EndolockError,
    HardwareError,
    did_you_mean,
    for_people,
)
from endolock.scripts.interruption import ended_at_once, interrupted_once

DESCRIPTION = (
    "Digital twin of a robot-steered flexible endoscope, and its target lock. "
    "Laboratory software, not a medical device."
)


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        args: arguments after `endolock`; those of the process if None.

    Returns:
        Exit code: 0 done, 2 wrong usage or configuration, 3 hardware fault, 130 interrupted.
    """
    return guarded(_dispatch, sys.argv[1:] if args is None else list(args))


def guarded(call: Callable[[list[str]], int], args: list[str]) -> int:
    """Call a command with its arguments; report each expected error in one line and a code."""
    try:
        with interrupted_once(), _damage_in_one_line():
            code = call(args)
            sys.stdout.flush()  # here, so that a closed pipe is handled below
        return code
    except HardwareError as error:
        return _fail(for_people(error), 3)
    except EndolockError as error:
        return _fail(for_people(error), 2)
    except KeyboardInterrupt as stop:
        return _fail(f"interrupted {stop}", 130)
    except SystemExit as stop:  # --help
        return stop.code if isinstance(stop.code, int) else 2 if stop.code else 0
    except BrokenPipeError:
        # The reader closed the pipe; keep Python from reporting it again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def parse(kind: Any, prog: str, args: list[str]) -> Any:
    """Parse arguments into a request.

    Raises:
        ConfigError: the arguments are not valid.
        SystemExit: help was asked for and printed.
    """
    import tyro

    captured = io.StringIO()
    try:
        with contextlib.redirect_stderr(captured):
            return tyro.cli(kind, prog=prog, args=args, description=DESCRIPTION)
    except SystemExit as stop:
        if stop.code:
            raise ConfigError(fold(captured.getvalue())) from None
        raise


def fold(box: str) -> str:
    """Turn a framed message of several lines into one line, without title, frame and help text.

    The frame is drawn in box characters, or with dashes where the terminal does not support them.
    """
    rows = [row.strip("│╭╮╰╯ ") for row in box.splitlines()]
    rules = [i for i, row in enumerate(rows) if re.fullmatch("[─-]{8,}", row)]
    titled = bool(rows) and bool(re.match("─", rows[0]))
    start = 1 if titled else rules[0] + 1 if rules else 0
    end = next((i for i in rules if i > start), len(rows))
    text = [row for row in rows if row and not re.fullmatch("[─-]+", row)]
    message = " ".join(row for row in rows[start:end] if row in text)
    return f"{message.rstrip('.')}. {text[-1].rstrip('.')}" if text else "wrong usage"


def _dispatch(args: list[str]) -> int:
    # Imported here, so that a Ctrl-C or an import error is reported in one line.
    with ended_at_once():
        import tyro

        from endolock.scripts.commands.doctor import examination

    if args == ["--version"]:
        print(endolock.__version__)
        return 0
    if args[:1] == ["doctor"]:  # it must work where other commands cannot be imported
        known = {"doctor": examination}
        request = _parsed(examination.Request, "endolock doctor", args[1:], args, known)
        return _carried_out(examination, request)
    with ended_at_once():
        modules = _commands()
    modules["doctor"] = examination
    kinds = [Annotated[m.Request, tyro.conf.subcommand(name)] for name, m in modules.items()]
    request = _parsed(Union[tuple(kinds)], "endolock", args, args, modules)  # noqa: UP007
    (command,) = (m for m in modules.values() if type(request) is m.Request)
    return _carried_out(command, request)


def _commands() -> dict[str, Any]:
    """Import the modules of all commands but doctor, by name."""
    try:
        from endolock.scripts.commands import (
            benchmark,
            board,
            bus,
            calibrate,
            compare,
            emulator,
            hysteresis,
            identify,
            latency,
            run,
            view,
            watch,
        )
    except (ImportError, AttributeError, RuntimeError) as error:
        # When imported, MuJoCo loads OpenGL through the library that MUJOCO_GL selects.
        if not endolock.opengl():
            raise
        raise ConfigError(
            f"MuJoCo cannot load OpenGL with MUJOCO_GL={endolock.opengl()} ({error})",
            "install that library (Debian and Ubuntu: apt install libegl1 libgl1), or unset it",
        ) from error
    return {
        "run": run,
        "compare": compare,
        "hysteresis": hysteresis,
        "identify": identify,
        "latency": latency,
        "board": board,
        "calibrate": calibrate,
        "watch": watch,
        "bus": bus,
        "view": view,
        "emulator": emulator,
        "benchmark": benchmark,
    }


def _parsed(kind: Any, prog: str, rest: list[str], args: list[str], modules: dict[str, Any]) -> Any:
    """Parse the rest of the arguments; propose a name where one is misspelt."""
    if args and args[0] in modules:
        _check_lists(args[1:], modules[args[0]].Request)
    try:
        return parse(kind, prog, rest)
    except ConfigError as error:
        raise ConfigError(f"{error.what}{_proposal(args, modules)}") from None


def _check_lists(args: list[str], kind: Any) -> None:
    """Check that no option that takes several values is repeated: only the last would count.

    Raises:
        ConfigError: one is.
    """
    given = Counter(arg.partition("=")[0] for arg in args if arg.startswith("--"))
    for name, hint in get_type_hints(kind, include_extras=True).items():
        option = f"--{name.replace('_', '-')}"
        count = given[option] + (given[f"--{name}"] if "_" in name else 0)
        if count > 1 and get_origin(hint) is tuple:
            raise ConfigError(f"{option} is given {count} times", "give it once, with all values")


def _proposal(args: list[str], modules: dict[str, Any]) -> str:
    """Return "; did you mean NAME?" for the first command or option that does not exist."""
    command = args[0] if args else "-"
    if command not in modules:
        return "" if command.startswith("-") else did_you_mean(command, modules)
    names = [field.name.replace("_", "-") for field in fields(modules[command].Request)]
    options = [f"--{name}" for name in (*names, *(f"no-{name}" for name in names), "help")]
    given = (arg.partition("=")[0].replace("_", "-") for arg in args[1:] if arg.startswith("--"))
    unknown = next((option for option in given if option not in options), "")
    return did_you_mean(unknown, options) if unknown else ""


def _carried_out(command: Any, request: Any) -> int:
    """Carry out a command; with --json - its JSON has standard output for itself."""
    from endolock.scripts.runs import output

    alone = getattr(request, "json", None) == "-"
    with output.json_alone() if alone else contextlib.nullcontext():
        return int(command.main(request))


@contextlib.contextmanager
def _damage_in_one_line() -> Iterator[None]:
    """Print each warning of a damaged run folder once, in one line."""
    said: set[str] = set()
    with warnings.catch_warnings():
        plain = warnings.showwarning

        def show(message: Any, category: type[Warning], *where: Any, **more: Any) -> None:
            if not issubclass(category, DamageWarning):
                plain(message, category, *where, **more)
            elif str(message) not in said:
                said.add(str(message))
                print(f"endolock: warning: {message}", file=sys.stderr)

        warnings.simplefilter("always", DamageWarning)
        warnings.showwarning = show
        yield


def _fail(message: str, code: int) -> int:
    print(f"endolock: {' '.join(message.split())}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
