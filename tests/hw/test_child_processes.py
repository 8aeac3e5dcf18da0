"""Child processes of Python execute no file of the working folder."""

import multiprocessing
import os
import subprocess
from pathlib import Path

import pytest
from tests import traps

from endolock.hw import child_processes


def test_a_module_is_run_away_from_the_working_folder(tmp_path: Path) -> None:
    traps.lay(tmp_path)
    command = child_processes.command("calendar", "2026", "11")
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert not traps.sprung(tmp_path)
    assert done.returncode == 0
    assert "November 2026" in done.stdout


@pytest.mark.parametrize("before", [None, "", "1"])
def test_workers_are_started_away_from_it_and_the_environment_stays(
    before: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    traps.lay(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    if before is not None:
        monkeypatch.setenv("PYTHONSAFEPATH", before)
    environment = dict(os.environ)
    with child_processes.safe_path(), multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(abs, (-3,)) == 3
    assert not traps.sprung(tmp_path)
    assert dict(os.environ) == environment
