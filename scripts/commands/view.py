"""`endolock view`: show a run in the Rerun viewer."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console

import endolock
from endolock.hw.api import ConfigError


@dataclass(frozen=True, kw_only=True)
class Request:
    """Open a run folder in the Rerun viewer, deriving run.rrd from its tables."""

    folder: tyro.conf.Positional[Path]
    """The run folder."""


def main(request: Request) -> int:
    """Carry out `endolock view`; return the exit code."""
    from endolock.scripts.figures import rerun_export  # loads Rerun, one second

    console = Console()
    if not request.folder.is_dir():
        raise ConfigError(
            f"{request.folder} is not a folder", "give a run folder, such as runs/..."
        )
    with console.status("deriving run.rrd"):
        rerun_export.derive(request.folder)
    show(request.folder, console)
    return 0


def show(folder: Path, console: Console) -> None:
    """Open run.rrd if there is a screen; otherwise print how to view it."""
    path = folder / "run.rrd"
    if not endolock.has_screen():
        console.print(
            f"no screen; wrote {path}. Open it in a browser with: rerun {path} --serve-web",
            soft_wrap=True,
            highlight=False,
            markup=False,
        )
        return
    subprocess.Popen([sys.executable, "-m", "rerun", str(path)], start_new_session=True)
