"""HTTP server of one page and its event stream on the loopback interface."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType

from rpctl.errors import RpctlError
from rpctl.view.serve.events import Stream

LOOPBACK = "127.0.0.1"
EVENTS = "/events"
CLIENT_TIMEOUT_S = 30.0  # s; a client that neither asks nor listens for as long is dropped

PageSource = Callable[[], bytes]


class PageServer:
    """Serves one page on a free port of the loopback interface inside the ``with`` block.

    Args:
        page: Returns the page; called for every request. An OSError is answered with 404, the
            message of an RpctlError is what the page says.
        stream: The events at ``EVENTS``, if there are any; closed in the end.

    Attributes:
        url: Where the page is.
    """

    def __init__(self, page: PageSource, stream: Stream | None = None) -> None:
        self._server = _Server(page, stream)
        self.url = f"http://{LOOPBACK}:{self._server.server_port}/"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True)

    def __enter__(self) -> PageServer:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._server.stream is not None:
            self._server.stream.close()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def serve(self, page: PageSource) -> None:
        """Serve another page from now on."""
        self._server.page = page

    @property
    def delivered(self) -> int:
        """How often the page was delivered completely."""
        return self._server.delivered

    def wait_delivered(self, count: int, seconds: float) -> bool:
        """Wait until the page was delivered ``count`` times; return whether it was in time."""
        with self._server.delivery:
            return self._server.delivery.wait_for(lambda: self._server.delivered >= count, seconds)


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, page: PageSource, stream: Stream | None) -> None:
        self.page, self.stream = page, stream
        self.making = threading.Lock()  # one page at a time: loading a robot is not for threads
        self.delivered, self.delivery = 0, threading.Condition()
        super().__init__((LOOPBACK, 0), _Handler)

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore a client that disconnects; report every other error."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    server_version, sys_version = "rpctl", ""
    timeout = CLIENT_TIMEOUT_S

    def do_GET(self) -> None:
        self._answer(body=True)

    def do_HEAD(self) -> None:
        self._answer(body=False)

    def _answer(self, body: bool) -> None:
        # A page elsewhere whose name was made to point here must not read ours.
        port = self.server.server_port
        if self.headers.get("Host") not in (f"{LOOPBACK}:{port}", f"localhost:{port}"):
            self.send_error(HTTPStatus.FORBIDDEN)
        elif self.path == "/":
            self._send_page(body)
        elif self.path == EVENTS and self.server.stream is not None and body:
            self._send_events(self.server.stream)
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def _send_page(self, body: bool) -> None:
        try:
            with self.server.making:
                content = self.server.page()
        except OSError:
            self.send_error(HTTPStatus.NOT_FOUND, "the page is gone")
            return
        except RpctlError as error:
            text = str(error).encode()
            self._send_head("text/plain; charset=utf-8", len(text), HTTPStatus.CONFLICT)
            if body:
                self.wfile.write(text)
            return
        self._send_head("text/html; charset=utf-8", len(content))
        if body:
            self.wfile.write(content)
            with self.server.delivery:
                self.server.delivered += 1
                self.server.delivery.notify_all()

    def _send_events(self, stream: Stream) -> None:
        """Send the events that the page has not seen yet, then every new one."""
        last = self.headers.get("Last-Event-ID", "")
        self._send_head("text/event-stream")
        with stream.reading():
            for event in stream.events(int(last) + 1 if last.isascii() and last.isdigit() else 0):
                self.wfile.write(event)

    def _send_head(
        self, kind: str, length: int | None = None, status: HTTPStatus = HTTPStatus.OK
    ) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        if length is not None:
            self.send_header("Content-Length", str(length))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing; the terminal shows only the URL."""
