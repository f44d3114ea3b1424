"""HTTP server of one page and its event stream on the loopback interface, behind a token."""

from __future__ import annotations

import hmac
import json
import re
import secrets
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import islice
from typing import Any

from rpctl.errors import RpctlError

LOOPBACK = "127.0.0.1"
# Places below the token, which a page asks for relative to itself: to be sent a motion, to ask for
# one, to end one.
PAGE, EVENTS, GO, STOP = "", "events", "go", "stop"
TOKEN_BYTES = 24  # of the address's secret part: 192 bits are not guessed
CLIENT_TIMEOUT_S = 30.0  # s; a client that neither asks nor listens for as long is dropped

MAX_REQUEST = 65_536  # bytes of what a page may ask for
EVENT_NUMBER = re.compile(r"[0-9]{1,18}")  # Python refuses to read thousands of digits
JSON_TYPE = "application/json"
NO_TOKEN = "there is no page here: open the whole address that rpctl printed, with its secret part"
HEADERS = {  # of every answer, refusals included
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the address is a secret
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    # Adds to the page's own policy: a page cannot forbid its framing by itself.
    "Content-Security-Policy": "frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
}

KEEPALIVE_S = (
    5.0  # s; a silent stream says this often that it is there, and notices a page that left
)
MAX_KEPT_BYTES = 4 * 2**20  # of the latest events; some eight minutes of a robot's motion
RECONNECT_S = 3.0  # s; a page that is loaded again is away for less

PageSource = Callable[[], bytes]
Action = Callable[[Any], object]  # what a page can ask for; an RpctlError says why not


class Stream:
    """A log of server-sent events.

    Attributes:
        readers: Number of pages reading now.
    """

    def __init__(self) -> None:
        self._log: deque[bytes] = deque()
        self._size = 0  # bytes of the log
        self._first = 0  # number of the first event that is kept
        self._closed = False
        self.readers = 0
        self._left = -float("inf")
        self._changed = threading.Condition()

    def send(self, kind: str, value: Any) -> None:
        """Add an event.

        Args:
            kind: Its name in the page.
            value: Its data, sent as JSON.
        """
        data = json.dumps(value, separators=(",", ":"), allow_nan=False)
        with self._changed:
            event = f"id: {self._first + len(self._log)}\nevent: {kind}\ndata: {data}\n\n".encode()
            self._log.append(event)
            self._size += len(event)
            while self._size > MAX_KEPT_BYTES and len(self._log) > 1:
                self._size -= len(self._log.popleft())
                self._first += 1
            self._changed.notify_all()

    def forget(self) -> None:
        """Drop the events so far; a page that comes later does not receive them."""
        with self._changed:
            self._first += len(self._log)
            self._log.clear()
            self._size = 0

    def close(self) -> None:
        """End the stream; pages still receive the events already sent."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def events(self, first: int = 0) -> Iterator[bytes]:
        """Yield the events from number ``first`` on, waiting for each, until the stream is closed.

        A comment that pages ignore comes where there is no event for ``KEEPALIVE_S`` seconds.
        """
        at, closed = first, False

        def news() -> bool:
            return self._closed or self._first + len(self._log) > at

        while not closed:
            with self._changed:
                self._changed.wait_for(news, KEEPALIVE_S)
                batch = [*islice(self._log, max(at - self._first, 0), None)]
                closed = self._closed
                at = self._first + len(self._log)
            yield b"".join(batch) or b":\n\n"

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Count a page as a reader inside the ``with`` block."""
        with self._changed:
            self.readers += 1
            self._changed.notify_all()
        try:
            yield
        finally:
            with self._changed:
                self.readers -= 1
                self._left = time.monotonic()

    @property
    def watched(self) -> bool:
        """Whether a page reads now, or did within the last ``RECONNECT_S`` seconds."""
        return self.readers > 0 or time.monotonic() - self._left < RECONNECT_S

    def wait_reader(self, seconds: float) -> bool:
        """Wait until a page reads; return whether one came in time."""
        with self._changed:
            return self._changed.wait_for(lambda: self.readers > 0, seconds)


class PageServer(ThreadingHTTPServer):
    """Serves one page on a free port of the loopback interface inside the ``with`` block.

    All users of a machine reach its loopback interface. The address has a random token, and
    nothing is answered without it: who was not given the address reads nothing, and stops nothing.

    Args:
        page: Returns the page; called for every request. An OSError is answered with 404, the
            message of an RpctlError is what the page says.
        stream: The events at ``EVENTS``, if there are any; closed in the end.
        actions: What the page, and no other, can ask for by POST: by its place below the token,
            called with the JSON that was sent. The message of an RpctlError is the answer.

    Attributes:
        url: Where the page is, its token included; it ends in a slash.
        page: Returns the page that is served.
        delivered: How often the page was delivered completely.

    Raises:
        RpctlError: The loopback interface has no port for it.
    """

    daemon_threads = True

    def __init__(
        self,
        page: PageSource,
        stream: Stream | None = None,
        actions: Mapping[str, Action] | None = None,
    ) -> None:
        self.page, self.stream, self.actions = page, stream, actions or {}
        self.token = secrets.token_urlsafe(TOKEN_BYTES)
        self.making = threading.Lock()  # one page at a time: loading a robot is not for threads
        self.delivered, self.delivery = 0, threading.Condition()
        try:
            super().__init__((LOOPBACK, 0), _Handler)
        except OSError as error:
            reason = error.strerror or error
            raise RpctlError(f"{LOOPBACK}: no page can be served here: {reason}") from None
        self.url = f"http://{LOOPBACK}:{self.server_port}/{self.token}/"
        self._thread = threading.Thread(target=self.serve_forever, args=(0.1,), daemon=True)

    def __enter__(self) -> PageServer:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self.stream is not None:
            self.stream.close()
        self.shutdown()
        self.server_close()
        self._thread.join()

    def wait_delivered(self, count: int, seconds: float) -> bool:
        """Wait until the page was delivered ``count`` times; return whether it was in time."""
        with self.delivery:
            return self.delivery.wait_for(lambda: self.delivered >= count, seconds)

    def handle_error(self, request: object, client_address: object) -> None:
        """Ignore a client that disconnects; report every other error."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handle_error(request, client_address)  # type: ignore[arg-type]


class _Handler(BaseHTTPRequestHandler):
    server: PageServer
    server_version, sys_version = "rpctl", ""
    timeout = CLIENT_TIMEOUT_S

    def do_GET(self) -> None:
        place, stream = self._place(), self.server.stream
        if place == PAGE:
            self._send_page()
        elif place == EVENTS and stream is not None:
            self._send_events(stream)
        elif place is not None:
            self.send_error(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:
        """Do what the page asks for; a page from elsewhere has another origin, and is refused."""
        place = self._place()
        if place is None:
            return
        action = self.server.actions.get(place)
        length = self.headers.get("Content-Length", "")
        if self.headers.get("Origin") != f"http://{self.headers.get('Host')}":
            self.send_error(HTTPStatus.FORBIDDEN)
        elif action is None:
            self.send_error(HTTPStatus.NOT_FOUND)
        elif self.headers.get("Content-Type") != JSON_TYPE:
            self.send_error(HTTPStatus.UNSUPPORTED_MEDIA_TYPE)
        elif not (length.isascii() and length.isdigit() and int(length) <= MAX_REQUEST):
            self.send_error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        else:
            self._send(*_answer(action, self.rfile.read(int(length))))

    def _place(self) -> str | None:
        """Return what is asked for below the token; None: the request was refused.

        A page elsewhere whose name was made to point here must not read ours, so the request names
        this server. Another user of the machine does not know the token; how long the comparison
        takes does not tell how much of a guess is right.
        """
        port = self.server.server_port
        if self.headers.get("Host") not in (f"{LOOPBACK}:{port}", f"localhost:{port}"):
            self.send_error(HTTPStatus.FORBIDDEN)
            return None
        token, slash, place = self.path.removeprefix("/").partition("/")
        if hmac.compare_digest(token.encode("latin-1"), self.server.token.encode()) and slash:
            return place
        self._send(NO_TOKEN, HTTPStatus.NOT_FOUND)
        return None

    def _send_page(self) -> None:
        try:
            with self.server.making:
                content = self.server.page()
        except OSError:
            self.send_error(HTTPStatus.NOT_FOUND, "the page is gone")
            return
        except RpctlError as error:
            self._send(str(error), HTTPStatus.CONFLICT)
            return
        self._send(content, kind="text/html")
        with self.server.delivery:
            self.server.delivered += 1
            self.server.delivery.notify_all()

    def _send(
        self, content: str | bytes, status: HTTPStatus = HTTPStatus.OK, kind: str = "text/plain"
    ) -> None:
        data = content.encode() if isinstance(content, str) else content
        self.send_response(status)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def _send_events(self, stream: Stream) -> None:
        """Send the events that the page has not seen yet, then every new one."""
        last = EVENT_NUMBER.fullmatch(self.headers.get("Last-Event-ID", ""))
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/event-stream")
        self.end_headers()
        with stream.reading():
            for event in stream.events(int(last[0]) + 1 if last else 0):
                self.wfile.write(event)

    def end_headers(self) -> None:
        """Send the head with what all answers carry, those that the library writes included."""
        for name, value in HEADERS.items():
            self.send_header(name, value)
        super().end_headers()

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing; the terminal shows only the URL."""


def _answer(action: Action, sent: bytes) -> tuple[str, HTTPStatus]:
    """Do what a page asks for; return what it is told."""
    try:
        asked = json.loads(sent, parse_int=float, parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        return "this is no JSON", HTTPStatus.BAD_REQUEST
    try:
        action(asked)
    except RpctlError as error:
        return str(error), HTTPStatus.CONFLICT
    return "", HTTPStatus.OK


def _refuse_constant(name: str) -> None:
    """Refuse NaN and Infinity, which are no JSON."""
    raise ValueError(name)
