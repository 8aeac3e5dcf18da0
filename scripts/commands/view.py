"""`endolock view`: show a run in the Rerun viewer."""

from __future__ import annotations

import ipaddress
import shlex
import subprocess
from dataclasses import dataclass
from pathlib import Path

import tyro
from rich.console import Console

import endolock
from endolock.hw import child_processes
from endolock.hw.api import ConfigError

LOCAL = "127.0.0.1"
"""The address of this machine that only its own programs reach."""
PORTS = "9090 and 9876"
"""Ports on which Rerun serves the page and the recording."""


@dataclass(frozen=True, kw_only=True)
class Request:
    """Open a run folder in the Rerun viewer, deriving run.rrd from its tables."""

    folder: tyro.conf.Positional[Path]
    """The run folder."""
    host: str = LOCAL
    """Address on which the viewer serves the run; only programs on this machine reach the default.
    0.0.0.0: every machine that reaches this one can read the run, without a password."""


def main(request: Request) -> int:
    """Carry out `endolock view`; return the exit code."""
    from endolock.scripts.figures import rerun_export  # loads Rerun, one second

    console = Console()
    exposed = not _address(request.host).is_loopback
    if not request.folder.is_dir():
        raise ConfigError(
            f"{request.folder} is not a folder", "give a run folder, such as runs/..."
        )
    with console.status("deriving run.rrd"):
        rerun_export.derive(request.folder)
    if exposed:
        Console(stderr=True).print(
            f"warning: any machine that reaches {request.host} can read this run (ports {PORTS}), "
            f"without a password; without --host only this machine can",
            soft_wrap=True,
            highlight=False,
            markup=False,
        )
    show(request.folder, console, request.host)
    return 0


def show(folder: Path, console: Console, host: str = LOCAL) -> None:
    """Open run.rrd if there is a screen; otherwise print how to view it.

    Args:
        folder: a run folder with run.rrd.
        console: where to print.
        host: address on which the viewer listens.
    """
    path = folder / "run.rrd"
    viewer = child_processes.command("rerun", str(path.resolve()), "--bind", host)
    if endolock.has_screen():
        subprocess.Popen(viewer, start_new_session=True)
        return
    console.print(
        f"no screen; wrote {path}. Open it in a browser with: {shlex.join(viewer)} --serve-web",
        soft_wrap=True,
        highlight=False,
        markup=False,
    )


def _address(host: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    """Read the address of a network interface.

    Raises:
        ConfigError: it is not an address.
    """
    try:
        return ipaddress.ip_address(host)
    except ValueError:
        raise ConfigError(
            f"--host {host} is not an address", f"use {LOCAL} for this machine, or 0.0.0.0 for all"
        ) from None
