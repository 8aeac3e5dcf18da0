"""`endolock view`: the viewer and its servers are reached from this machine only."""

import os
import shlex
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests import traps
from tests.sockets import listening

from endolock.scripts import cli

PORTS = ["--port", "auto", "--web-viewer-port", "0"]
"""Free ones, so that tests beside this one do not matter."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("runs") / "a run"
    args = ["run", "rest", "--vision", "truth", "--duration-s", "0.1", "--out", str(path)]
    assert cli.main(args) == 0
    return path


@pytest.fixture
def no_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)


def _printed_command(folder: Path, capsys: pytest.CaptureFixture[str], *args: str) -> list[str]:
    assert cli.main(["view", str(folder), *args]) == 0
    return shlex.split(capsys.readouterr().out.partition("with: ")[2])


@pytest.fixture
def served(
    folder: Path, no_screen: None, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Iterator[subprocess.Popen[bytes]]:
    """The printed command, executed as it is elsewhere, without anything on the path."""
    command = [*_printed_command(folder, capsys), *PORTS]
    traps.lay(tmp_path)
    process = subprocess.Popen(
        command, cwd=tmp_path, env={"HOME": str(tmp_path)}, stdout=subprocess.DEVNULL
    )
    yield process
    for pid in (*_below(process.pid), process.pid):
        os.kill(pid, signal.SIGTERM)
    process.wait(10)
    assert not traps.sprung(tmp_path)


def test_the_printed_command_serves_the_run_on_this_machine_only(
    served: subprocess.Popen[bytes],
) -> None:
    deadline = time.monotonic() + 60  # a busy machine; it takes 1 s
    addresses: set[str] = set()
    while len(addresses) < 2 and time.monotonic() < deadline:
        assert served.poll() is None, "it has ended"
        time.sleep(0.1)
        addresses = {a for child in _below(served.pid) for a in listening(child)}
    assert len(addresses) == 2  # the page, and the recording
    assert {address.rpartition(":")[0] for address in addresses} == {"127.0.0.1"}


def test_the_window_listens_on_this_machine_only(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said, viewer = tmp_path / "said", tmp_path / "viewer"
    viewer.write_text(f'#!/bin/sh\necho "$@" >{said}.part && mv {said}.part {said}\n')
    viewer.chmod(viewer.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("RERUN_CLI_PATH", str(viewer))  # Rerun's own way to name another viewer
    monkeypatch.setenv("DISPLAY", ":77")
    traps.lay(tmp_path)
    command = [sys.executable, "-P", "-m", "endolock.scripts.cli", "view", str(folder)]
    subprocess.run(command, cwd=tmp_path, check=True)
    deadline = time.monotonic() + 60
    while not said.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert said.read_text() == f"{folder / 'run.rrd'} --bind 127.0.0.1\n"
    assert not traps.sprung(tmp_path)


def test_a_run_shown_afterwards_is_served_on_this_machine_only(
    no_screen: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    args = ["run", "rest", "--vision", "truth", "--duration-s", "0.1", "--view"]
    assert cli.main([*args, "--out", str(tmp_path / "run")]) == 0
    assert "run.rrd --bind 127.0.0.1 --serve-web" in capsys.readouterr().out


def test_host_opens_it_with_a_warning(
    folder: Path, no_screen: None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["view", str(folder), "--host", "0.0.0.0"]) == 0
    said = capsys.readouterr()
    assert "--bind 0.0.0.0" in said.out
    assert said.err.startswith("warning: any machine that reaches 0.0.0.0 can read this run")
    assert cli.main(["view", str(folder), "--host", "::1"]) == 0
    assert not capsys.readouterr().err


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1:9090", "0", "127.0.0.1 --serve-grpc"])
def test_host_is_an_address(host: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["view", str(folder), "--host", host]) == 2
    assert f"--host {host} is not an address; use 127.0.0.1" in capsys.readouterr().err


def _below(pid: int) -> list[int]:
    """Return the processes that a process has started, and theirs."""
    found = []
    for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        found += [int(child), *_below(int(child))]
    return found
