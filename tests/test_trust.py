"""Nothing that comes from outside is executed, and few modules start processes or open ports."""

import ast
from functools import cache
from pathlib import Path

import pytest
from tests.test_layout import LAYERS, ROOT

CODE_FROM_DATA = {
    *("pickle", "marshal", "shelve", "dill", "joblib", "yaml", "runpy", "code"),
    *("eval", "exec", "compile", "__import__"),
    *("os.system", "os.popen", "cv2.FileStorage", "np.load", "numpy.load", "pd.read_pickle"),
}
"""What makes code or objects of any kind from data."""
OUTSIDE = {
    "hw/child_processes.py": {"sys.executable"},
    "hw/camera/picture_stream.py": {"http.server", "socket"},
    "scripts/commands/view.py": {"subprocess"},  # the viewer, by child_processes
    "scripts/commands/board.py": {"webbrowser"},  # a page written just before
    "scripts/commands/doctor/examination.py": {"sys.executable"},  # in an advice
    "scripts/runs/batch.py": {"multiprocessing"},  # within child_processes.safe_path
    "scripts/runs/stopping.py": {"socket"},  # a pair, for signals
    "twin/hil/hil_rig.py": {"subprocess", "socket", "multiprocessing.connection"},  # a pair
    "twin/hil/hil_server.py": {"multiprocessing.connection"},  # the other of the pair
}
"""Modules that start processes or listen, and with what."""
WATCHED = {
    *("subprocess", "multiprocessing", "multiprocessing.connection", "concurrent.futures.process"),
    *("socket", "socketserver", "http.server", "xmlrpc.server", "asyncio", "webbrowser", "pty"),
    *("sys.executable", "os.fork", "os.execv", "os.posix_spawn"),
}
FILES = [file for layer in LAYERS for file in sorted((ROOT / layer).rglob("*.py"))]


@cache
def _names(file: Path) -> set[str]:
    """Return the modules that a file imports, and the dotted names and functions that it uses."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {node.module or "", *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Attribute):
            found.add(ast.unparse(node))
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            found.add(node.func.id)
        elif isinstance(node, ast.keyword) and node.arg == "shell":
            found.add("shell=")
    return found


@pytest.mark.parametrize("layer", LAYERS)
def test_no_data_becomes_code(layer: str) -> None:
    for file in FILES:
        if file.is_relative_to(ROOT / layer):
            assert not _names(file) & (CODE_FROM_DATA | {"shell="}), file


def test_only_these_modules_start_processes_or_listen() -> None:
    found = {str(f.relative_to(ROOT)): names for f in FILES if (names := _names(f) & WATCHED)}
    assert found == OUTSIDE
