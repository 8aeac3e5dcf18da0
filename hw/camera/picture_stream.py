"""Pictures as a stream for any program on this machine: Motion JPEG over HTTP.

The camera of an emulated bench: `video_camera.VideoCamera` opens its address like that of a network
camera.
"""

from __future__ import annotations

from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Condition, Thread

import cv2

from endolock.hw.api import ConfigError, Image

HOST = "127.0.0.1"
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
        stream = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                stream._serve(self)

            def log_message(self, *_: object) -> None:
                pass

        try:
            self._server = ThreadingHTTPServer((HOST, port), Handler)
        except (OSError, OverflowError) as error:
            raise ConfigError(
                f"cannot serve pictures on port {port}: {error}", "use another port"
            ) from None
        self._server.daemon_threads = True
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

    def _serve(self, handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(200)
        kind = f"multipart/x-mixed-replace; boundary={_BOUNDARY}"
        handler.send_header("Content-Type", kind)
        handler.end_headers()
        shown = 0
        while (news := self._after(shown)) is not None:
            shown, data = news
            head = f"--{_BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}"
            try:
                handler.wfile.write(head.encode() + b"\r\n\r\n" + data + b"\r\n")
            except OSError:  # the client has gone
                return

    def _after(self, shown: int) -> tuple[int, bytes] | None:
        """Wait for a newer picture; return its number and JPEG, or None once closed."""
        with self._news:
            self._news.wait_for(lambda: self._closed or self._count > shown)
            return None if self._closed else (self._count, self._newest)
