"""HTTP server of one page and its event stream on the loopback interface."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from types import TracebackType
from typing import Any

from rpctl.errors import RpctlError
from rpctl.view.serve.events import Stream

LOOPBACK = "127.0.0.1"
EVENTS = "/events"
CLIENT_TIMEOUT_S = 30.0  # s; a client that neither asks nor listens for as long is dropped

MAX_REQUEST = 65_536  # bytes of what a page may ask for
JSON_TYPE = "application/json"

PageSource = Callable[[], bytes]
Action = Callable[[Any], object]  # what a page can ask for; an RpctlError says why not


class PageServer:
    """Serves one page on a free port of the loopback interface inside the ``with`` block.

    Args:
        page: Returns the page; called for every request. An OSError is answered with 404, the
            message of an RpctlError is what the page says.
        stream: The events at ``EVENTS``, if there are any; closed in the end.
        actions: What the page, and no other, can ask for by POST: by its path, called with the
            JSON that was sent. The message of an RpctlError is the answer.

    Attributes:
        url: Where the page is.
    """

    def __init__(
        self,
        page: PageSource,
        stream: Stream | None = None,
        actions: Mapping[str, Action] | None = None,
    ) -> None:
        self._server = _Server(page, stream, actions or {})
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

    def __init__(
        self, page: PageSource, stream: Stream | None, actions: Mapping[str, Action]
    ) -> None:
        self.page, self.stream, self.actions = page, stream, actions
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

    def do_POST(self) -> None:
        """Do what the page asks for; a page from elsewhere has another origin, and is refused."""
        action = self.server.actions.get(self.path)
        length = self.headers.get("Content-Length", "")
        own = self._is_own() and self.headers.get("Origin") == f"http://{self.headers.get('Host')}"
        if not own:
            self.send_error(HTTPStatus.FORBIDDEN)
        elif action is None:
            self.send_error(HTTPStatus.NOT_FOUND)
        elif self.headers.get("Content-Type") != JSON_TYPE:
            self.send_error(HTTPStatus.UNSUPPORTED_MEDIA_TYPE)
        elif not (length.isascii() and length.isdigit() and int(length) <= MAX_REQUEST):
            self.send_error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        else:
            self._act(action, self.rfile.read(int(length)))

    def _act(self, action: Action, sent: bytes) -> None:
        try:
            asked = json.loads(sent, parse_int=float, parse_constant=_refuse_constant)
        except (ValueError, RecursionError):
            self._send_text("this is no JSON", HTTPStatus.BAD_REQUEST)
            return
        try:
            action(asked)
        except RpctlError as error:
            self._send_text(str(error), HTTPStatus.CONFLICT)
        else:
            self._send_text("", HTTPStatus.OK)

    def _is_own(self) -> bool:
        """Return whether the request is for this server by its own name.

        A page elsewhere whose name was made to point here must not read ours.
        """
        port = self.server.server_port
        return self.headers.get("Host") in (f"{LOOPBACK}:{port}", f"localhost:{port}")

    def _answer(self, body: bool) -> None:
        if not self._is_own():
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
            self._send_text(str(error), HTTPStatus.CONFLICT, body)
            return
        self._send_head("text/html; charset=utf-8", len(content))
        if body:
            self.wfile.write(content)
            with self.server.delivery:
                self.server.delivered += 1
                self.server.delivery.notify_all()

    def _send_text(self, text: str, status: HTTPStatus, body: bool = True) -> None:
        content = text.encode()
        self._send_head("text/plain; charset=utf-8", len(content), status)
        if body:
            self.wfile.write(content)

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


def _refuse_constant(name: str) -> None:
    """Refuse NaN and Infinity, which are no JSON."""
    raise ValueError(name)
