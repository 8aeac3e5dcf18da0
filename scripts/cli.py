"""The console command `endolock`: one sub-command per script, one line per error."""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
from collections.abc import Sequence
from typing import Annotated, Any

import tyro

from endolock.hw.api import EndolockError, HardwareError


def main(args: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        args: words after `endolock`; those of the process if None.

    Returns:
        0 done, 2 wrong usage or configuration, 3 hardware fault, 130 interrupted.
    """
    try:
        return _dispatch(sys.argv[1:] if args is None else list(args))
    except HardwareError as error:
        return _fail(str(error), 3)
    except EndolockError as error:
        return _fail(str(error), 2)
    except KeyboardInterrupt:
        return _fail("interrupted", 130)
    except BrokenPipeError:
        # The reader of our output has gone; keep Python from complaining about it at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _dispatch(args: list[str]) -> int:
    try:
        from endolock.scripts import bench, run, view
    except ImportError as error:
        # MuJoCo loads OpenGL when it is imported, through what MUJOCO_GL names.
        where = f" with MUJOCO_GL={os.environ['MUJOCO_GL']}" if "MUJOCO_GL" in os.environ else ""
        return _fail(f"cannot load{where}: {error}; unset MUJOCO_GL, or see README.md", 2)
    commands = Annotated[run.Request, tyro.conf.subcommand("run")]
    commands |= Annotated[view.Request, tyro.conf.subcommand("view")]  # type: ignore[assignment]
    commands |= Annotated[bench.Request, tyro.conf.subcommand("bench")]  # type: ignore[assignment]
    request = _parse(commands, args)
    if isinstance(request, int):
        return request
    modules: dict[type, Any] = {run.Request: run, view.Request: view, bench.Request: bench}
    return int(modules[type(request)].main(request))


def _parse(commands: Any, args: list[str]) -> Any:
    """Parse the words; return a request, or the exit code where there is nothing to do."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            return tyro.cli(
                commands,
                prog="endolock",
                args=args,
                description="Digital twin of a robot-steered flexible endoscope, and its target "
                "lock. Laboratory software, not a medical device.",
            )
    except SystemExit as stop:
        if not stop.code:
            return 0
        return _fail(fold(said.getvalue()), 2)


def fold(box: str) -> str:
    """Turn a framed message of several lines into one line without frame or help text."""
    lines = [line.strip("│╭╮╰╯─ \t") for line in box.splitlines()]
    rules = [i for i, line in enumerate(box.splitlines()) if re.fullmatch(r"│? *─{8,} *│?", line)]
    end = rules[0] if rules else len(lines)
    last = next((line for line in reversed(lines) if line), "")
    return f"{' '.join(line for line in lines[1:end] if line).rstrip('.')}. {last}"


def _fail(message: str, code: int) -> int:
    print(f"endolock: {' '.join(message.split())}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
