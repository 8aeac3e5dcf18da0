"""Whole runs over a serial line: equal to the twin in lock-step, safe whatever ends them.

Those in wall time drive an emulator in a process of its own, as a bench would be driven.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from endolock.control import loop, registry
from endolock.hw.api import DeviceFault, HardwareError, PortGone
from endolock.hw.bench.wall_clock import WallClock
from endolock.hw.dynamixel import bus_log
from endolock.hw.dynamixel import registers as reg
from endolock.hw.dynamixel.port import serial_port
from endolock.hw.dynamixel.servo_bus import Bus
from endolock.hw.emulator.wire_faults import parse
from endolock.scripts import cli
from endolock.scripts.runs import bus_replay, run_folder
from endolock.twin.hil.hil_rig import HilRig
from endolock.vision.truth_eyes import TruthEyes

NAMES = {1: "up_down", 2: "left_right"}
TRIES = 5
PATIENCE_S = 60.0
"""For what another process does; this machine may be busy."""


@pytest.mark.parametrize(("eyes", "seconds"), [("markers", "1.5"), ("truth", "12")])
def test_hil_equals_the_twin_bit_for_bit(eyes: str, seconds: str, tmp_path: Path) -> None:
    records = {}
    for rig in ("twin", "hil"):
        args = ["run", "straight", "--rig", rig, "--controller", "pi", "--seed", "5"]
        args += ["--vision", eyes, "--duration-s", seconds, "--out", str(tmp_path / rig)]
        assert cli.main([*args, "--json", str(tmp_path / f"{rig}.json")]) == 0
        records[rig] = json.loads((tmp_path / f"{rig}.json").read_text())
        for name in ("rig", "wall_s", "real_time_factor"):
            del records[rig][name]
    assert records["twin"] == records["hil"]
    for table in ("ticks", "frames"):
        one, other = ((tmp_path / rig / f"{table}.arrows").read_bytes() for rig in records)
        assert one == other


def test_hil_repeats_itself_bit_for_bit_over_a_line_with_faults(tmp_path: Path) -> None:
    faults = tuple(parse(text) for text in ("lost=0.2@0.1", "late=0.003@0.1"))
    for name in ("a", "b"):
        with HilRig("circle", seed=3, pictures=False, faults=faults) as rig:
            folder = run_folder.RunFolder(tmp_path / name, rig.describe())
            rig.line.record(folder.path / run_folder.BUS_LOG)
            law = registry.make("pi", rig.camera.calibration)
            loop.run(rig, TruthEyes(rig.truth), law, duration_s=2, recorder=folder)
            folder.close()
    for file in ("ticks.arrows", "frames.arrows", "bus.log"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_a_log_replays_through_the_drivers_that_wrote_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    args = ["run", "circle", "--rig", "hil", "--vision", "truth", "--duration-s", "2"]
    assert cli.main([*args, "--out", str(out)]) == 0
    capsys.readouterr()
    assert cli.main(["bus", str(out), "--json", "-"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["requests_equal"]
    assert result["positions_equal"] == result["ticks"] == 101
    assert result["damaged"] == result["unanswered"] == 0
    assert cli.main(["bus", str(out), "--packets"]) == 0
    said = capsys.readouterr().out
    assert "> all goals 1: 2048, 2: 2048" in said
    assert "<   2 block, error 0x00: watchdog 20, torque 1, hardware_error 0" in said
    # Cut off anywhere it is readable up to the last whole record.
    log = out / "bus.log"
    whole = list(bus_log.read(log))
    log.write_bytes(log.read_bytes()[:-5])
    assert list(bus_log.read(log)) == whole[:-1]


@pytest.mark.parametrize(
    ("fault", "kind", "text"),
    [
        ("overheat:2@0.5", DeviceFault, r"^handle motor 2 \(left_right\) stopped: it is too hot"),
        ("reset:1@0.5", DeviceFault, r"^handle motor 1 \(up_down\) has restarted"),
        ("unplug@0.5", PortGone, r"is gone; the motors hold where they are"),
    ],
)
def test_a_fault_leaves_a_complete_folder(
    fault: str, kind: type[HardwareError], text: str, tmp_path: Path
) -> None:
    out = tmp_path / "run"

    def run() -> None:
        with HilRig("circle", pictures=False, faults=(parse(fault),)) as rig:
            folder = run_folder.RunFolder(out, rig.describe())
            rig.line.record(out / run_folder.BUS_LOG)
            law = registry.make("pi", rig.camera.calibration)
            try:
                loop.run(rig, TruthEyes(rig.truth), law, duration_s=2, recorder=folder)
            finally:
                folder.close()

    with pytest.raises(kind, match=text) as caught:  # also where closing fails after it
        run()
    assert 0.5 <= caught.value.t <= 0.54  # found with the next tick or the one after
    ticks = run_folder.read(out, "ticks")
    assert ticks["t"].to_pylist() == pytest.approx([0.02 * n for n in range(ticks.num_rows)])
    assert ticks["t"][-1].as_py() == pytest.approx(caught.value.t - 0.02)  # the tick before
    result = bus_replay.replay(out)
    assert result.requests_equal
    assert result.positions_equal == ticks.num_rows


@pytest.fixture
def emulator(tmp_path: Path) -> Iterator[Path]:
    """An emulated bench in wall time: the path of its line, with bench.toml beside it."""
    link, said = tmp_path / "servo", tmp_path / "emulator.txt"
    command = [sys.executable, "-m", "endolock.scripts.cli", "emulator", "--link", str(link)]
    with said.open("w") as file:
        process = subprocess.Popen([*command, "--video", "0"], stdout=file, cwd=tmp_path, text=True)
    try:
        _wait(lambda: "Ctrl-C ends" in said.read_text(), process)
        address = said.read_text().split("camera at ")[1].split(";")[0]
        (tmp_path / "bench.toml").write_text(
            f'[camera]\nsource = "{address}"\n'
            "[handle.up_down]\nid = 1\nzero_counts = 2048\n"
            "[handle.left_right]\nid = 2\nzero_counts = 2048\n"
        )
        yield link
    finally:
        process.terminate()
        assert process.wait(PATIENCE_S) == 0
        assert not link.exists()


@pytest.mark.wall_time
def test_a_killed_run_leaves_a_readable_folder_and_still_handles(
    emulator: Path, tmp_path: Path
) -> None:
    process, folder = _start(emulator, tmp_path)
    process.kill()
    process.communicate(timeout=PATIENCE_S)
    ticks, frames = run_folder.read(folder, "ticks"), run_folder.read(folder, "frames")
    assert ticks.num_rows > 10
    assert frames.num_rows > 5
    result = bus_replay.replay(folder)
    assert result.requests_equal
    # The last cycles may not have reached the table, which is written with every frame.
    assert result.positions_equal == ticks.num_rows
    clock = WallClock()
    line = Bus(serial_port(emulator, 1_000_000), clock, NAMES)
    line.open()  # the kernel has released the port
    try:
        clock.sleep_until(0.5)
        # Pinged by nobody for longer than the watchdog waits, both have stopped by themselves.
        assert [line.read(i, reg.WATCHDOG) for i in NAMES] == [reg.TRIPPED, reg.TRIPPED]
        assert [line.read(i, reg.TORQUE_ENABLE) for i in NAMES] == [1, 1]  # and hold
        first = line.sync_read(list(NAMES), reg.POSITION)
        clock.sleep_until(1.5)
        later = line.sync_read(list(NAMES), reg.POSITION)
        assert all(abs(later[i] - first[i]) <= 1 for i in NAMES)  # between two counts
    finally:
        line.close()


@pytest.mark.wall_time
def test_a_run_that_resumes_after_a_stop_ends_with_the_watchdog_fault(
    emulator: Path, tmp_path: Path
) -> None:
    if sys.platform == "win32":
        pytest.skip("Windows cannot stop a process")
    process, folder = _start(emulator, tmp_path)
    process.send_signal(signal.SIGSTOP)
    time.sleep(1.0)
    process.send_signal(signal.SIGCONT)
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 3
    assert "stopped by itself: it received no packet for 0.4 s" in said
    assert run_folder.read(folder, "ticks").num_rows > 10


@pytest.mark.wall_time
def test_two_programs_cannot_share_one_port(emulator: Path, tmp_path: Path) -> None:
    first = serial_port(emulator, 1_000_000)
    first.open()
    try:
        args = ["run", "rest", "--rig", f"serial:{emulator}", "--out", str(tmp_path / "second")]
        done = subprocess.run(
            [sys.executable, "-m", "endolock.scripts.cli", *args],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 3
        assert f"{emulator} is in use by another program" in done.stderr
        assert not (tmp_path / "second").exists()
    finally:
        first.close()


def _start(link: Path, place: Path) -> tuple[subprocess.Popen[str], Path]:
    """Start a long run on a line and wait until it has written some frames.

    A machine that is busy elsewhere for 0.1 s is a silent line to it, so it gets several tries.
    """
    for n in range(TRIES):
        folder = place / f"run{n}"
        command = [sys.executable, "-m", "endolock.scripts.cli", "run", "rest"]
        command += ["--rig", f"serial:{link}", "--duration-s", "3600", "--out", str(folder)]
        process = subprocess.Popen(
            command, cwd=place, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
        )
        frames = folder / "frames.arrows"
        end = time.monotonic() + PATIENCE_S
        while process.poll() is None and time.monotonic() < end:
            if frames.exists() and frames.stat().st_size > 300_000:
                return process, folder
            time.sleep(0.1)
        process.kill()
        _, said = process.communicate()
    raise AssertionError(f"no run in {TRIES} tries; the last said: {said}")


def _wait(done: Callable[[], bool], process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + PATIENCE_S
    while not done():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.1)
