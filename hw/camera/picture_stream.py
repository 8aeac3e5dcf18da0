"""Pictures as a stream for any program on this machine: Motion JPEG over HTTP.

The camera of an emulated bench: `video_camera.VideoCamera` opens its address like that of a network
camera.
"""

from __future__ import annotations

import socket
import sys
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import BoundedSemaphore, Condition, Thread, Timer
from typing import Any

import cv2

from endolock.hw.api import ConfigError, Image

HOST = "127.0.0.1"
"""The address of this machine that only its own programs reach."""
MAX_CLIENTS = 8
"""Maximum number of connections at once; further ones are closed. Assumed: more than the programs
that watch one camera."""
TIMEOUT_S = 5.0
"""Time in which a client must send its request, and then take each picture [s]; otherwise it is
disconnected. Assumed: far longer than any program on the same machine needs."""
QUALITY = 90
"""JPEG quality, 0 to 100. Assumed: corners of markers move by less than 0.02 px."""
_BOUNDARY = "picture"


class PictureStream:
    """Serves each new picture to all clients.

    Args:
        port: TCP port on this machine; 0 for any free one.

    Raises:
        ConfigError: the port is in use.
    """

    def __init__(self, port: int) -> None:
        self._news = Condition()
        self._newest, self._count, self._closed = b"", 0, False
        try:
            self._server = _Server(self, port)
        except (OSError, OverflowError) as error:
            raise ConfigError(
                f"cannot serve pictures on port {port}: {error}", "use another port"
            ) from None
        self.address = f"http://{HOST}:{self._server.server_port}/"
        """Its address, to be opened by clients."""
        self._thread = Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def send(self, image: Image) -> None:
        """Send a picture, RGB."""
        bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        _, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
        with self._news:
            self._newest, self._count = data.tobytes(), self._count + 1
            self._news.notify_all()

    def close(self) -> None:
        """End the stream for all clients; may be called twice."""
        with self._news:
            self._closed = True
            self._news.notify_all()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def after(self, shown: int) -> tuple[int, bytes] | None:
        """Wait for a newer picture; return its number and JPEG, or None once closed."""
        with self._news:
            self._news.wait_for(lambda: self._closed or self._count > shown)
            return None if self._closed else (self._count, self._newest)


class _Server(ThreadingHTTPServer):
    """Serves a limited number of clients, each in a thread.

    Args:
        stream: gives the pictures.
        port: TCP port.
    """

    daemon_threads = True

    def __init__(self, stream: PictureStream, port: int) -> None:
        self.stream = stream
        self._places = BoundedSemaphore(MAX_CLIENTS)
        super().__init__((HOST, port), _Client)

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Take a place; without one, the connection is closed."""
        free = self._places.acquire(blocking=False)
        if not free:
            with suppress(OSError):
                request.send(b"HTTP/1.0 503 Too many clients\r\n\r\n")
        return free

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a client, then give its place back."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._places.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of clients that leave or are too slow."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Client(BaseHTTPRequestHandler):
    """One connection: a request, then pictures until the stream or the client ends."""

    server: _Server

    def setup(self) -> None:
        """Start the time for the whole request, however slowly it comes."""
        super().setup()
        self.connection.settimeout(TIMEOUT_S)  # also for each picture as a whole
        self._deadline = Timer(TIMEOUT_S, self._cut)
        self._deadline.daemon = True
        self._deadline.start()

    def do_GET(self) -> None:
        """Send pictures, whatever the path is."""
        self._deadline.cancel()
        self.send_response(200)
        self.send_header("Content-Type", f"multipart/x-mixed-replace; boundary={_BOUNDARY}")
        self.end_headers()
        shown = 0
        while (news := self.server.stream.after(shown)) is not None:
            shown, data = news
            head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}"
            self.wfile.write(head.encode() + b"\r\n\r\n" + data + b"\r\n")

    def finish(self) -> None:
        """End the time for the request, if there was none."""
        self._deadline.cancel()
        super().finish()

    def log_message(self, *_: object) -> None:
        """Print nothing."""

    def _cut(self) -> None:
        with suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)
