"""Serial ports, on real pseudo-terminals: one owner, any baud rate, unplugging is reported."""

from __future__ import annotations

import fcntl
import os
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from struct import unpack

import pytest

from endolock.hw.api import ConfigError, PortBusy, PortGone
from endolock.hw.dynamixel.linux_port import SerialPort
from endolock.hw.dynamixel.port import Port, serial_port
from endolock.hw.emulator.pty_line import PtyLine

assert sys.platform == "linux"  # pseudo-terminals

pytestmark = pytest.mark.wall_time

LONG_S = 20.0
"""Time limit [s]; a test that reaches it has failed."""
SOON_S = 0.05
Make = Callable[[str | Path], Port]

TIOCGEXCL = 0x80045440
"""Asks whether a terminal is exclusive; not in `termios`."""
OWNER = """
import sys
from pathlib import Path
from endolock.hw.dynamixel.linux_port import SerialPort
port = SerialPort(sys.argv[1], 1_000_000)
port.open()
print("open", flush=True)
sys.stdin.read()
"""


def ours(path: str | Path) -> Port:
    """Make the port of Linux."""
    return SerialPort(path, 1_000_000)


def pyserials(path: str | Path) -> Port:
    """Make the port of other systems."""
    from endolock.hw.dynamixel.portable_port import PortablePort  # needs pyserial

    return PortablePort(path, 1_000_000)


@pytest.fixture(params=[ours, pytest.param(pyserials, marks=pytest.mark.extra)])
def make(request: pytest.FixtureRequest) -> Make:
    """Whatever is asked of a port is asked of each."""
    chosen: Make = request.param
    return chosen


@pytest.fixture
def line() -> Iterator[PtyLine]:
    """Plug a line in."""
    made = PtyLine()
    yield made
    made.close()


@pytest.fixture
def port(make: Make, line: PtyLine) -> Iterator[Port]:
    """Open a port at its near end."""
    made = make(line.path)
    made.open()
    yield made
    made.close()


def heard(line: PtyLine, size: int) -> bytes:
    """Return this number of bytes from the other end of the pty."""
    data, give_up = b"", time.monotonic() + LONG_S
    while len(data) < size and time.monotonic() < give_up:
        if line.wait(SOON_S):
            data += line.read()
    return data


def received(port: Port, size: int) -> bytes:
    """Return this number of bytes from the port."""
    data, give_up = b"", time.monotonic() + LONG_S
    while len(data) < size and time.monotonic() < give_up:
        data += port.receive(SOON_S)
    return data


@contextmanager
def owner(path: str) -> Iterator[subprocess.Popen[str]]:
    """Let another process open a port, and keep it until its input ends."""
    command, pipe = [sys.executable, "-c", OWNER, path], subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdout
        assert process.stdout.readline() == "open\n"
        yield process


def gone(name: str) -> str:
    """Return the pattern of the message for an unplugged port."""
    return (
        f"^{name} is gone; the motors hold where they are, by their own watchdog; plug it in "
        r"again, then clear_fault\(\) and enable\(\)$"
    )


# Any port: what a bus relies on.


def test_every_byte_goes_through_unchanged(port: Port, line: PtyLine) -> None:
    everything = bytes(range(256)) + b"\r\n\x03\x04\x11\x13\x7f"
    port.send(everything)
    assert heard(line, len(everything)) == everything
    line.write(everything)
    assert received(port, len(everything)) == everything
    assert port.receive(0.0) == b""  # nothing comes back as an echo
    assert line.read() == b""


@pytest.mark.parametrize("baud", [9_600, 57_600, 123_457, 1_000_000, 3_000_000, 4_500_000])
def test_the_other_end_of_the_pty_sees_the_baud_rate(port: Port, line: PtyLine, baud: int) -> None:
    assert line.baud == 1_000_000
    port.set_baud(baud)
    assert line.baud == baud


def test_a_baud_rate_set_before_opening_is_used(port: Port, line: PtyLine) -> None:
    port.set_baud(57_600)
    port.open()
    assert line.baud == 57_600


def test_a_terminal_in_line_mode_is_set_to_raw_mode(port: Port, line: PtyLine) -> None:
    port.close()
    fd = os.open(line.path, os.O_RDWR | os.O_NOCTTY)
    modes = termios.tcgetattr(fd)
    modes[0] |= termios.ICRNL | termios.IXON
    modes[1] |= termios.OPOST | termios.ONLCR
    modes[3] |= termios.ICANON | termios.ECHO | termios.ISIG
    termios.tcsetattr(fd, termios.TCSANOW, modes)
    os.close(fd)
    port.open()
    test_every_byte_goes_through_unchanged(port, line)


def test_bytes_sent_before_closing_arrive(port: Port, line: PtyLine) -> None:
    port.send(b"good-bye")
    port.close()
    assert heard(line, 8) == b"good-bye"
    assert not line.wait(0.0)


def test_bytes_from_before_it_was_opened_are_discarded(port: Port, line: PtyLine) -> None:
    line.write(b"old")
    port.open()
    line.write(b"new")
    assert received(port, 3) == b"new"


def test_it_waits_for_the_first_byte(port: Port, line: PtyLine) -> None:
    later = threading.Timer(SOON_S, line.write, [b"at last"])
    later.start()
    assert port.receive(LONG_S)
    later.join()


def test_it_does_not_wait_longer_than_its_timeout(port: Port) -> None:
    start = time.monotonic()
    assert port.receive(0.0) == b""
    assert port.receive(-1.0) == b""
    assert port.receive(SOON_S) == b""
    assert time.monotonic() - start >= SOON_S


def test_more_bytes_than_the_buffer_holds_are_sent_completely(port: Port, line: PtyLine) -> None:
    much = os.urandom(200_000)  # a pty holds some 64 KiB
    sender = threading.Thread(target=port.send, args=[much])
    sender.start()
    assert heard(line, len(much)) == much
    sender.join()


def test_a_second_owner_is_refused(make: Make, port: Port, line: PtyLine) -> None:
    message = f"^{port.name} is in use by another program; close that program, then connect\\(\\)$"
    with pytest.raises(PortBusy, match=message):
        make(line.path).open()
    port.send(b"mine")
    assert heard(line, 4) == b"mine"
    port.close()
    other = make(line.path)
    other.open()
    other.close()


def test_a_port_in_use_by_another_process_is_refused(make: Make, line: PtyLine) -> None:
    port = make(line.path)
    with owner(line.path), pytest.raises(PortBusy, match="is in use by another program"):
        port.open()
    port.open()
    port.close()


def test_a_killed_owner_releases_the_port(make: Make, line: PtyLine) -> None:
    with owner(line.path) as process:
        process.kill()
    port = make(line.path)
    port.open()
    port.close()
    # Where this runs as root, being exclusive would not have kept us out.
    fd = os.open(line.path, os.O_RDWR | os.O_NOCTTY)
    assert unpack("i", fcntl.ioctl(fd, TIOCGEXCL, bytes(4))) == (0,)
    os.close(fd)


USES: dict[str, Callable[[Port], object]] = {
    "receive": lambda port: port.receive(LONG_S),
    "look": lambda port: port.receive(0.0),
    "send": lambda port: port.send(b"?"),
    "set_baud": lambda port: port.set_baud(57_600),
}


@pytest.mark.parametrize("use", USES.values(), ids=USES.keys())
def test_an_unplugged_port_is_distinguished_from_a_silent_one(
    port: Port, line: PtyLine, use: Callable[[Port], object]
) -> None:
    line.unplug()
    for _ in range(2):
        with pytest.raises(PortGone, match=gone(port.name)):
            use(port)


@pytest.mark.parametrize("use", USES.values(), ids=USES.keys())
def test_a_closed_port_raises_port_gone(
    make: Make, port: Port, line: PtyLine, use: Callable[[Port], object]
) -> None:
    port.close()
    port.close()
    for closed in (port, make(line.path)):  # one that never was open
        with pytest.raises(PortGone, match=gone(port.name)):
            use(closed)


def test_unplugging_ends_a_wait(port: Port, line: PtyLine) -> None:
    later = threading.Timer(SOON_S, line.unplug)
    later.start()
    with pytest.raises(PortGone, match=gone(port.name)):
        port.receive(LONG_S)
    later.join()


def test_a_replugged_port_is_found_by_its_link(make: Make, tmp_path: Path) -> None:
    line = PtyLine(tmp_path / "handles")
    port = make(line.path)
    port.open()
    before = Path(line.path).resolve()
    line.plug_in()  # while the port is open, so that the name is another one
    assert Path(line.path).resolve() != before
    with pytest.raises(PortGone):
        port.receive(LONG_S)
    port.open()
    port.send(b"again")
    assert heard(line, 5) == b"again"
    port.close()
    line.close()


def test_an_unplugged_port_cannot_be_opened(make: Make, tmp_path: Path) -> None:
    line = PtyLine(tmp_path / "handles")
    port = make(line.path)
    port.open()
    line.unplug()
    with pytest.raises(PortGone, match=f"^{port.name} cannot be opened "):
        port.open()
    line.plug_in()
    port.open()
    port.close()
    line.close()


def test_a_missing_port_raises_port_gone(make: Make, tmp_path: Path) -> None:
    message = r"/none cannot be opened \(.*\); plug it in, and see endolock doctor$"
    with pytest.raises(PortGone, match=message):
        make(tmp_path / "none").open()


def test_a_file_that_is_not_a_serial_port_is_refused(make: Make, tmp_path: Path) -> None:
    file = tmp_path / "notes.txt"
    file.write_text("keep me")
    message = (
        rf"^{file} is not a serial port \(.*Inappropriate ioctl for device.*\); "
        "list them with endolock doctor$"
    )
    with pytest.raises(ConfigError, match=message):
        make(file).open()
    assert file.read_text() == "keep me"


# Lasting names.


def test_a_port_is_found_again_by_its_persistent_name(tmp_path: Path) -> None:
    by_id = tmp_path / "by-id"
    by_id.mkdir()
    (by_id / "another").symlink_to(tmp_path / "elsewhere")
    line = PtyLine(by_id / "usb-adapter-if00")
    name = str(Path(line.path).resolve())
    port = SerialPort(name, 1_000_000, by_id)
    port.open()
    line.plug_in()
    with pytest.raises(PortGone, match=gone(name)):
        port.receive(LONG_S)
    port.open()
    port.send(b"again")
    assert heard(line, 5) == b"again"
    assert port.name == name  # as people know it
    port.close()
    line.close()


def test_a_folder_of_persistent_names_is_not_needed(line: PtyLine, tmp_path: Path) -> None:
    port = SerialPort(line.path, 1_000_000, tmp_path / "none")
    for _ in range(2):
        port.open()
    port.close()


def test_on_linux_the_port_is_the_linux_one() -> None:
    assert isinstance(serial_port("/dev/ttyUSB0", 57_600), SerialPort)
