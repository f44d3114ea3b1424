"""A report over HTTP on the loopback interface: that one file, and nothing beside it."""

from __future__ import annotations

import signal
import threading
import webbrowser
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import FrameType, TracebackType

from rpctl.errors import RpctlError

LOOPBACK = "127.0.0.1"


class ReportServer:
    """Serves one report on a free port of the loopback interface while it is entered.

    Attributes:
        path: The report.
        url: Where it is served.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if not self.path.is_file():
            raise RpctlError(f"{path}: no such report; write one with rpctl track")
        self._server = _Server(self.path)
        self.url = f"http://{LOOPBACK}:{self._server.server_port}/"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True)

    def __enter__(self) -> ReportServer:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


def serve(
    path: str | Path, ready: Callable[[str], None] = print, *, open_browser: bool = False
) -> None:
    """Serve a report until Ctrl-C or SIGTERM; called from the main thread.

    Args:
        path: The report.
        ready: Called with the URL once it is served.
        open_browser: Open the URL in the user's browser.

    Raises:
        RpctlError: There is no such report.
    """
    done = threading.Event()

    def stop(number: int, frame: FrameType | None) -> None:
        done.set()

    signals = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.signal(number, stop) for number in signals}
    try:
        with ReportServer(path) as server:
            ready(server.url)
            if open_browser:
                webbrowser.open(server.url)
            done.wait()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, path: Path) -> None:
        self.path = path
        super().__init__((LOOPBACK, 0), _Handler)


class _Handler(BaseHTTPRequestHandler):
    server: _Server
    server_version, sys_version = "rpctl", ""

    def do_GET(self) -> None:
        self._answer(body=True)

    def do_HEAD(self) -> None:
        self._answer(body=False)

    def _answer(self, body: bool) -> None:
        # A page elsewhere whose name was made to point here must not read the report.
        port = self.server.server_port
        if self.headers.get("Host") not in (f"{LOOPBACK}:{port}", f"localhost:{port}"):
            self.send_error(HTTPStatus.FORBIDDEN)
            return
        if self.path != "/":
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        try:
            content = self.server.path.read_bytes()
        except OSError:
            self.send_error(HTTPStatus.NOT_FOUND, "the report is gone")
            return
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(content)))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        if body:
            self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:
        """Stay quiet: a terminal shows the URL, not every request."""
