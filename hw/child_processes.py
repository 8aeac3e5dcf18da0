"""Child processes of Python that import nothing from the working folder.

With `python -m`, and with `python -c` as multiprocessing uses it, the working folder comes first on
the module path: a file of the user there, named random.py for example, would be executed in place
of the module of that name.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator

_SAFE_PATH = "PYTHONSAFEPATH"


def command(module: str, *args: str) -> list[str]:
    """Return the command that runs a module in a process of its own.

    Args:
        module: its full name.
        args: its arguments.
    """
    return [sys.executable, "-P", "-m", module, *args]


@contextlib.contextmanager
def safe_path() -> Iterator[None]:
    """Keep the working folder off the path of all Python processes that are started inside.

    For multiprocessing with the start method spawn, which sends the module path of this process to
    the new one, but starts that by `python -c`.
    """
    before = os.environ.get(_SAFE_PATH)
    os.environ[_SAFE_PATH] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_SAFE_PATH]
        else:
            os.environ[_SAFE_PATH] = before
