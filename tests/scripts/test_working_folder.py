"""Commands execute no file of the folder they are called in, but the law file they are given."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests import traps

from endolock.scripts.runs import batch
from endolock.scripts.runs.experiment import Experiment

ENDOLOCK = shutil.which("endolock", path=str(Path(sys.executable).parent))
LAW = """
import gain_of_mine
from endolock import Command

class Law:
    def reset(self, state): ...
    def update(self, t, state, observation):
        return Command(position=(gain_of_mine.GOAL, 0.0))

def make(calibration):
    return Law()
"""
SHORT = ["run", "rest", "--vision", "truth", "--duration-s", "0.1", "--out", "run"]


def _endolock(folder: Path, *args: str) -> subprocess.CompletedProcess[str]:
    assert ENDOLOCK
    return subprocess.run([ENDOLOCK, *args], cwd=folder, capture_output=True, text=True)


@pytest.mark.parametrize(
    "args",
    [
        [*SHORT, "--controller", "law.py"],
        [*SHORT, "--rig", "hil", "--controller", "law.py"],
        ["doctor"],
    ],
)
def test_files_beside_a_law_are_not_executed_in_place_of_modules(
    args: list[str], tmp_path: Path
) -> None:
    traps.lay(tmp_path)
    (tmp_path / "law.py").write_text(LAW)
    (tmp_path / "gain_of_mine.py").write_text("GOAL = 0.1\n")
    done = _endolock(tmp_path, *args)
    assert not traps.sprung(tmp_path)
    assert done.returncode == 0, done.stderr


def test_workers_of_a_batch_execute_none_of_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    traps.lay(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(batch, "WORKERS", 1)
    (run,) = batch.perform([Experiment(scenario="rest", vision="truth", duration_s=0.1)])
    assert run is not None
    assert not traps.sprung(tmp_path)
