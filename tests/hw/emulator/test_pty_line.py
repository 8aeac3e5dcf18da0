"""The emulator's end of a line: its link, and what becomes of bytes when nobody is there."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from endolock.hw.api import ConfigError
from endolock.hw.dynamixel.linux_port import SerialPort
from endolock.hw.emulator.pty_line import PtyLine


@pytest.fixture
def line() -> Iterator[PtyLine]:
    """Plug a line in."""
    made = PtyLine()
    yield made
    made.close()


def test_a_link_always_leads_to_a_line(tmp_path: Path) -> None:
    link = tmp_path / "handles"
    line = PtyLine(link)

    def look() -> set[Path]:
        return {link.readlink().parent for _ in range(5000)}  # raises where there is none

    with ThreadPoolExecutor() as pool:
        looking = pool.submit(look)
        while not looking.done():
            line.plug_in()
        assert looking.result() == {Path("/dev/pts")}
    line.close()
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_not_a_link_is_not_replaced(tmp_path: Path) -> None:
    file = tmp_path / "handles"
    file.write_text("keep me")
    before = len(list(Path("/proc/self/fd").iterdir()))
    message = f"^{file} exists and is not a link; give another --link$"
    with pytest.raises(ConfigError, match=message):
        PtyLine(file)
    assert file.read_text() == "keep me"
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_a_link_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    link = tmp_path / "none" / "handles"
    message = f"^cannot write {link}: No such file or directory; give another --link$"
    with pytest.raises(ConfigError, match=message):
        PtyLine(link)


def test_a_link_that_now_points_elsewhere_is_kept(tmp_path: Path) -> None:
    link = tmp_path / "handles"
    first, second = PtyLine(link), PtyLine(link)
    first.close()
    first.close()
    assert link.is_symlink()
    second.close()
    assert not link.is_symlink()


def test_a_dangling_link_is_replaced(tmp_path: Path) -> None:
    link = tmp_path / "handles"
    link.symlink_to(tmp_path / "gone")
    line = PtyLine(link)
    assert link.resolve().parent == Path("/dev/pts")
    line.close()


def test_a_line_that_no_client_has_open_delivers_nothing(line: PtyLine) -> None:
    line.write(b"lost")
    assert not line.wait(0.0)
    assert line.read() == b""
    port = SerialPort(line.path, 1_000_000)
    port.open()
    assert port.receive(0.0) == b""
    port.close()


def test_an_unplugged_line_delivers_nothing(line: PtyLine) -> None:
    assert line.plugged
    line.unplug()
    line.unplug()
    assert not line.plugged
    assert line.fileno() < 0
    line.write(b"lost")
    assert not line.wait(0.0)
    assert line.read() == b""
