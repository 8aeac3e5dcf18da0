"""Calls code of the user's own: laws, eyes, and what makes them; any error becomes one line.

Such code may raise anything, leave the program, print, close or replace standard output, and change
NumPy's handling of errors. What it raises becomes a `ConfigError` that names the line of its file;
errors of endolock keep their type and message; only a true Ctrl-C passes. Output and NumPy's
settings of the rest of the program stay as they are.
"""

from __future__ import annotations

import dis
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from contextvars import Context
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, NamedTuple, TextIO

from endolock.hw.api import ConfigError
from endolock.hw.errors import EndolockError


class Caller(NamedTuple):
    """Whose code is called, for messages, and in which context."""

    name: str
    """File or class."""
    source: Path | None
    """The file that defines it, if known."""
    context: Context
    """Holds what the code changes of NumPy's error handling and the like, from call to call."""
    quiet: bool = False
    """Whether it prints to standard error and not to standard output."""

    def call(self, what: str, call: Callable[[], Any]) -> Any:
        """Call user code.

        Args:
            what: what is called, for the message; empty while a file is executed.
            call: the code, with its arguments.

        Raises:
            ConfigError: it failed, or tried to leave the program.
            EndolockError: raised by the code itself, with a note that says where.
            KeyboardInterrupt: a Ctrl-C.
        """
        try:
            with _printing_to_stderr() if self.quiet else nullcontext():
                return self.context.run(call)
        except EndolockError as error:
            if self.quiet:  # from a file, whose user sees no traceback
                error.add_note(f"raised by {self.name}{_line(error, self.source, call)}")
            raise
        except BaseException as error:  # user code may raise anything
            if isinstance(error, KeyboardInterrupt) and not _raised_in(error, self.source):
                raise
            did = f"{what} failed" if what else "cannot be executed"
            why = f"{type(error).__name__}: {_text(error, self.source)}"
            raise ConfigError(
                f"{self.name}: {did}: {why}{_line(error, self.source, call)}"
            ) from error


def is_running(frame: FrameType | None) -> bool:
    """Whether user code is being called in a frame, or in one that led to it."""
    while frame is not None:
        if frame.f_code is Caller.call.__code__:
            return True
        frame = frame.f_back
    return False


def _text(error: BaseException, source: Path | None) -> str:
    if isinstance(error, SyntaxError) and error.filename == str(source):
        return error.msg
    try:
        return " ".join(str(error).split()) or "no message"
    except (Exception, SystemExit):
        return "its message cannot be shown"


def _line(error: BaseException, source: Path | None, call: Any) -> str:
    """Return the last line of the file that led to an error, in brackets; empty if unknown."""
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if source and Path(frame.filename) == source]
    code = getattr(getattr(call, "func", None), "__code__", None)
    if isinstance(error, SyntaxError) and error.filename == str(source):
        lines = [error.lineno]
    elif not lines and code and Path(code.co_filename) == source:
        lines = [code.co_firstlineno]  # a call with arguments that it does not take
    return f" (line {lines[-1]})" if lines else ""


def _raised_in(error: BaseException, source: Path | None) -> bool:
    """Whether a `raise` statement of a file raised an error, and not a signal on its way there."""
    trace: TracebackType | None = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    if trace is None or source is None:
        return False
    code = trace.tb_frame.f_code
    instruction = dis.opname[code.co_code[trace.tb_lasti]]
    return Path(code.co_filename) == source and instruction == "RAISE_VARARGS"


class _Output:
    """Standard output while quiet code runs: its threads write to standard error, others pass.

    Closing it does nothing; all else is that of standard output.
    """

    def __init__(self, before: TextIO | None) -> None:
        self.before = before
        self.users = 0

    def write(self, text: str) -> int:
        target = self._target()
        return target.write(text) if target else len(text)

    def flush(self) -> None:
        if target := self._target():
            target.flush()

    def close(self) -> None:
        pass

    def __getattr__(self, name: str) -> Any:
        return getattr(self._target(), name)

    def _target(self) -> TextIO | None:
        return sys.stderr if _quiet.depth else self.before


class _Quiet(threading.local):
    depth = 0


_quiet = _Quiet()
_lock = threading.Lock()
_output: _Output | None = None


@contextmanager
def _printing_to_stderr() -> Iterator[None]:
    """Let this thread print to standard error; afterwards both streams are what they were."""
    global _output
    errors = sys.stderr
    with _lock:
        _output = _output or _Output(sys.stdout)
        sys.stdout = _output  # all that a program needs of it
        _output.users += 1
    _quiet.depth += 1
    try:
        yield
    finally:
        _quiet.depth -= 1
        sys.stderr = errors
        with _lock:
            _output.users -= 1
            sys.stdout = _output if _output.users else _output.before
            _output = _output if _output.users else None
