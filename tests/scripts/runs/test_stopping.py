"""Stops by signals: at the end of a tick, within a law that hangs, and never while closing."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from endolock import Command, Experiment, Interrupted, Observation, SurrogateRig, read_run
from endolock.hw.api import State
from endolock.scripts.runs import stopping
from endolock.scripts.runs.hysteresis_measurement import HysteresisMeasurement
from endolock.scripts.runs.latency_measurement import LatencyMeasurement
from endolock.twin.rig import TwinRig

pytestmark = pytest.mark.wall_time


class Hanging:
    """Hangs from 0.1 s on, for 60 s of wall-clock time."""

    def __init__(self, hang: Callable[[float], Any]) -> None:
        self._hang = hang

    def reset(self, state: State) -> None:
        """Nothing to forget."""

    def update(self, t: float, state: State, observation: Observation | None) -> Command:
        """Hold, or hang."""
        if t > 0.1:
            self._hang(time.monotonic() + 60.0)
        return Command(position=(0.0, 0.0))


def spin(until: float) -> None:
    """Compute."""
    while time.monotonic() < until:
        pass


def sleep(until: float) -> None:
    """Sleep."""
    time.sleep(max(0.0, until - time.monotonic()))


def send(*signals: tuple[float, signal.Signals]) -> threading.Thread:
    """Send this process signals, each after some time [s]."""

    def run() -> None:
        for delay_s, number in signals:
            time.sleep(delay_s)
            os.kill(os.getpid(), number)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread


@pytest.mark.parametrize("hang", [spin, sleep])
@pytest.mark.parametrize(
    "signals",
    [
        ((1.0, signal.SIGINT), (0.5, signal.SIGINT)),
        ((1.0, signal.SIGTERM), (0.5, signal.SIGINT)),
        ((1.0, signal.SIGTERM),),
    ],
)
def test_a_stop_reaches_a_law_that_hangs(
    hang: Callable[[float], Any],
    signals: tuple[tuple[float, signal.Signals], ...],
    tmp_path: Path,
) -> None:
    with SurrogateRig("rest") as rig:
        experiment = Experiment(
            scenario=rig.scenario,
            rig=rig,
            controller=Hanging(hang),
            vision="truth",
            out=tmp_path / "run",
        )
        start = time.monotonic()
        sender = send(*signals)
        with pytest.raises(Interrupted) as caught:
            experiment.run()
        took_s = time.monotonic() - start
        assert rig.actuators.mode == "holding"
    sender.join()
    back = read_run(tmp_path / "run")
    assert back.record == caught.value.record
    assert back.record
    assert back.record.interrupted
    assert back.ticks["t"].to_pylist() == pytest.approx([0.02 * n for n in range(7)])
    # a second signal at once; a single one after GRACE_S; 5 s for a busy machine
    grace_s = stopping.GRACE_S if len(signals) == 1 else 0.0
    assert took_s < 1.5 + grace_s + 5.0


def test_a_first_signal_waits_for_the_end_of_the_tick(tmp_path: Path) -> None:
    finished: list[float] = []

    def half(_until: float) -> None:
        time.sleep(0.5)
        finished.append(time.monotonic())

    experiment = Experiment(
        scenario="rest",
        rig="surrogate",
        controller=lambda calibration: Hanging(half),
        vision="truth",
        out=tmp_path / "run",
    )
    sender = send((1.2, signal.SIGINT))
    with pytest.raises(Interrupted) as caught:
        experiment.run()
    sender.join()
    assert finished  # the law was not interrupted
    ticks = read_run(tmp_path / "run").ticks
    assert ticks["t"][-1].as_py() == pytest.approx(caught.value.record.duration_s)


@pytest.mark.parametrize(
    "measure",
    [
        lambda: LatencyMeasurement(strokes=4).run(),
        lambda: HysteresisMeasurement().run(),
        lambda: Experiment(scenario="rest", vision="truth", out=Path("run")).run(),
    ],
)
def test_further_signals_do_not_keep_a_rig_from_being_closed(
    measure: Callable[[], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    close, advance, closed = TwinRig.close, TwinRig.advance, []

    def impatient(rig: TwinRig) -> None:
        signal.raise_signal(signal.SIGINT)
        close(rig)
        signal.raise_signal(signal.SIGTERM)
        closed.append(rig.actuators.mode)

    def interrupt(rig: TwinRig, step: int) -> None:
        advance(rig, step)
        if rig.clock.now() > 0.2:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(TwinRig, "close", impatient)
    monkeypatch.setattr(TwinRig, "advance", interrupt)
    with pytest.raises(KeyboardInterrupt):
        measure()
    assert closed == ["disconnected"]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


LAW = """
import time
from endolock import Command

class Law:
    def reset(self, state): pass
    def update(self, t, state, seen):
        while t > 0.1:
            try:
                time.sleep(60)
            except BaseException:
                pass
        return Command(position=(0.1, 0.0))

def make(calibration): return Law()
"""


def test_a_kill_ends_even_a_law_that_catches_everything(tmp_path: Path) -> None:
    file, out = tmp_path / "law.py", tmp_path / "run"
    file.write_text(LAW)
    command = [sys.executable, "-P", "-m", "endolock.scripts.cli", "run", "rest", "--out", str(out)]
    command += ["--controller", str(file), "--vision", "truth", "--rig", "surrogate"]
    with subprocess.Popen([*command], stderr=subprocess.PIPE, text=True) as process:
        deadline = time.monotonic() + 60
        while not (out / "ticks.arrows").exists():
            assert time.monotonic() < deadline
            time.sleep(0.05)
        time.sleep(0.5)  # until it hangs
        process.terminate()
        _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    assert said.splitlines()[-1] == (
        "endolock: interrupted; the law did not stop, so it was abandoned"
    )
    assert "Traceback" not in said
    assert read_run(out).ticks.num_rows == 7  # all up to there


def test_a_signal_while_the_command_is_imported_ends_it_in_one_line(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-P",
        "-X",
        "importtime",
        "-m",
        "endolock.scripts.cli",
        "run",
        "rest",
    ]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=tmp_path) as process:
        assert process.stderr
        for line in process.stderr:
            if line.rstrip().endswith("numpy._core"):  # in the middle of the imports
                break
        process.send_signal(signal.SIGINT)
        said = process.stderr.read()
    assert process.returncode == 130
    lines = [line for line in said.splitlines() if not line.startswith("import time:")]
    assert lines == ["endolock: interrupted"]
    assert not list(tmp_path.iterdir())
