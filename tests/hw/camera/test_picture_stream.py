"""The picture stream: for this machine only, and no client can hold up another."""

import os
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
import pytest
from tests.sockets import listening

from endolock.hw.camera import picture_stream
from endolock.hw.camera.picture_stream import MAX_CLIENTS, PictureStream

NOISE = np.random.default_rng(0).integers(0, 255, (480, 640, 3), np.uint8)
"""400 kB as a JPEG: a client that does not read fills the buffers of its connection."""
REQUEST = b"GET / HTTP/1.0\r\n\r\n"
LONG_S = 30
"""Far more than a busy machine needs."""


@pytest.fixture
def stream(monkeypatch: pytest.MonkeyPatch) -> Iterator[PictureStream]:
    """A stream with a short time-out, and a new picture every 50 ms."""
    monkeypatch.setattr(picture_stream, "TIMEOUT_S", 1.0)
    made, ended = PictureStream(0), threading.Event()

    def send() -> None:
        while not ended.wait(0.05):
            made.send(NOISE)

    thread = threading.Thread(target=send)
    thread.start()
    yield made
    ended.set()
    thread.join()
    made.close()


@pytest.fixture
def connect(stream: PictureStream) -> Iterator[Callable[[], socket.socket]]:
    """Opens connections, which are closed at the end."""
    opened = []
    port = int(stream.address.rstrip("/").rpartition(":")[2])

    def new() -> socket.socket:
        opened.append(socket.create_connection(("127.0.0.1", port), timeout=LONG_S))
        return opened[-1]

    yield new
    for connection in opened:
        connection.close()


def _pictures(connection: socket.socket, count: int, request: bytes = REQUEST) -> bool:
    """Whether a client gets pictures now."""
    connection.sendall(request)
    data = b""
    while data.count(b"image/jpeg") < count:
        try:
            if not (more := connection.recv(1 << 20)):
                return False
        except ConnectionResetError:
            return False
        data += more
    return data.startswith(b"HTTP/1.0 200")


class Viewer:
    """A client that reads all the time, beside the test."""

    def __init__(self, connection: socket.socket) -> None:
        self._seen = 0
        assert _pictures(connection, 1)
        threading.Thread(target=self._read, args=(connection,), daemon=True).start()

    def _read(self, connection: socket.socket) -> None:
        with suppress(OSError):  # closed by the test
            while data := connection.recv(1 << 20):
                self._seen += data.count(b"image/jpeg")

    def goes_on(self) -> bool:
        """Whether it gets more pictures."""
        before, deadline = self._seen, time.monotonic() + LONG_S
        while self._seen < before + 3 and time.monotonic() < deadline:
            time.sleep(0.02)
        return self._seen >= before + 3


def _is_cut(connection: socket.socket) -> bool:
    """Whether the server ends the connection, rather than wait."""
    try:
        while connection.recv(1 << 20):
            pass
    except ConnectionResetError:
        pass
    except TimeoutError:
        return False
    return True


def test_it_listens_on_this_machine_only(stream: PictureStream) -> None:
    assert stream.address.removeprefix("http://").rstrip("/") in listening(os.getpid())
    assert stream.address.startswith("http://127.0.0.1:")


@pytest.mark.wall_time
def test_idle_connections_are_cut_and_do_not_keep_others_out(
    connect: Callable[[], socket.socket], capfd: pytest.CaptureFixture[str]
) -> None:
    idle = [connect() for _ in range(MAX_CLIENTS - 1)]
    good = Viewer(connect())
    refused = [connect() for _ in range(20)]
    assert all(_is_cut(connection) for connection in refused)
    assert all(_is_cut(connection) for connection in idle)
    assert good.goes_on()
    deadline = time.monotonic() + LONG_S  # a connection is cut just before its place is free
    while not _pictures(connect(), 5):
        assert time.monotonic() < deadline
    assert capfd.readouterr().err == ""


def test_a_request_that_comes_slowly_is_cut(connect: Callable[[], socket.socket]) -> None:
    slow, started = connect(), time.monotonic()
    slow.settimeout(0.1)
    for _ in range(100):  # a byte every 0.1 s, so that no single wait is long
        try:
            slow.sendall(b"G")
            if not slow.recv(1):
                break
        except TimeoutError:
            continue
        except OSError:
            break
    else:
        pytest.fail("never cut")
    assert time.monotonic() - started > 0.9  # the time-out, and not an error of another kind


@pytest.mark.wall_time
def test_clients_that_do_not_read_are_cut_and_slow_no_other(
    connect: Callable[[], socket.socket], capfd: pytest.CaptureFixture[str]
) -> None:
    deaf = [connect() for _ in range(MAX_CLIENTS - 1)]
    for connection in deaf:
        connection.sendall(REQUEST)
    good = Viewer(connect())
    time.sleep(2.5)  # 30 pictures of 400 kB fill all buffers; then the time-out passes
    assert all(_is_cut(connection) for connection in deaf)
    assert good.goes_on()
    assert capfd.readouterr().err == ""


def test_clients_that_leave_are_no_news(
    connect: Callable[[], socket.socket], capfd: pytest.CaptureFixture[str]
) -> None:
    before = threading.active_count()
    for n in range(3 * MAX_CLIENTS):
        connection = connect()
        if n % 3:
            connection.sendall(REQUEST if n % 3 == 1 else b"\0\xff" * 50 + b"\r\n\r\n")
        connection.close()
    deadline = time.monotonic() + LONG_S
    while threading.active_count() > before:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert _pictures(connect(), 1)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("path", ["/", "/../../etc/passwd", "/%2e%2e/x?y", "//"])
def test_every_path_is_the_stream(path: str, connect: Callable[[], socket.socket]) -> None:
    assert _pictures(connect(), 2, f"GET {path} HTTP/1.1\r\nHost: x\r\n\r\n".encode())


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "HEAD", "OPTIONS"])
def test_other_methods_are_refused(method: str, connect: Callable[[], socket.socket]) -> None:
    connection = connect()
    connection.sendall(f"{method} / HTTP/1.0\r\n\r\n".encode())
    assert connection.recv(1000).startswith(b"HTTP/1.0 501")
