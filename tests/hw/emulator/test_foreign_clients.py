"""Clients that know nothing of us drive emulated servos, as they are."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.hw.emulated import Emulated

from endolock.hw.emulator.bus_server import BusServer
from endolock.hw.emulator.pty_line import PtyLine

pytestmark = [pytest.mark.extra, pytest.mark.wall_time]

CLIENTS = Path(__file__).parent / "clients"
LONG_S = 60.0
"""Time limit for a client [s]."""
STEP_RAD = 0.0016  # 2 pi / 4096, rounded up
CLOSE = 20  # counts; at which the clients are content
CLOSE_RAD = 0.03


@pytest.fixture
def bench() -> Iterator[tuple[Emulated, str]]:
    """Serve two servos at the wall's pace; also tell where."""
    made, line, done = Emulated(), PtyLine(), threading.Event()
    emulator, start = BusServer(made.wire, line), time.monotonic()
    for servo in made.servos:
        servo.reboot_s = 0.1

    def serve() -> None:
        while not done.is_set():
            line.wait(0.005)
            made.clock.sleep_until(time.monotonic() - start)
            emulator.answer()

    server = threading.Thread(target=serve)
    server.start()
    yield made, line.path
    done.set()
    server.join()
    line.close()


def run(client: str, port: str) -> dict[str, str]:
    """Run a client; return what it printed, by what stands before the colon."""
    command = [sys.executable, str(CLIENTS / client), port]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LONG_S)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    lines = [line.partition(":") for line in done.stdout.splitlines()]
    return {name: rest.strip() for name, _, rest in lines}


def numbers(text: str) -> list[float]:
    """Return the numbers in a text."""
    return [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?", text)]


def switched_off(bench: Emulated) -> bool:
    """Wait for torque to be off: a client's last word may still be under way."""
    give_up = time.monotonic() + LONG_S
    while any(motor.on for motor in bench.motors) and time.monotonic() < give_up:
        time.sleep(0.01)
    return not any(motor.on for motor in bench.motors)


def test_the_vendors_library_drives_the_emulated_servos(bench: tuple[Emulated, str]) -> None:
    emulated, port = bench
    said = run("sdk_client.py", port)
    assert said["on the line"] == "{1: (1020, 45), 2: (1020, 45)}"
    assert {"motor 1 is a 1020, and starts anew", "motor 2 is a 1020, and starts anew"} < {*said}
    assert "Writing or Reading is not available" in said["another mode, with torque on"]
    assert numbers(said["before"]) == [2048, 2048]
    assert numbers(said["after"]) == pytest.approx([2400, 1700], abs=CLOSE)
    assert numbers(said["fast"]) == pytest.approx([2400, 1700], abs=CLOSE)
    assert "motor 1 has 12.0 V, motor 2 30 °C" in said
    assert (said["registered"], said["done"]) == ("2400", "2048")
    assert switched_off(emulated)


def test_rustypot_drives_the_emulated_servos(bench: tuple[Emulated, str]) -> None:
    emulated, port = bench
    said = run("rustypot_client.py", port)
    assert said["on the line"] == "{1: 1020, 2: 1020}"
    assert said["torque"] == "[True, True]"
    assert numbers(said["before"]) == pytest.approx([0, 0], abs=STEP_RAD)
    assert numbers(said["after"]) == pytest.approx([0.5, -0.6], abs=CLOSE_RAD)
    assert numbers(said["fast"]) == pytest.approx([0.5, -0.6], abs=CLOSE_RAD)
    assert said["errors"] == "[0, 0]"
    assert switched_off(emulated)


def test_one_client_after_another(bench: tuple[Emulated, str]) -> None:
    _, port = bench
    for client in ("rustypot_client.py", "sdk_client.py", "rustypot_client.py"):
        assert run(client, port)["on the line"].startswith("{1: ")
