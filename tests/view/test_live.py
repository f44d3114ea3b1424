from __future__ import annotations

import http.client
import signal
import socket
import subprocess
import sys
from pathlib import Path
from urllib.parse import urlsplit

import pytest

import rpctl
from rpctl.view.live import ReportServer

SERVE = """
import sys
from rpctl.view.live import serve
serve(sys.argv[1], lambda url: print(url, flush=True))
"""


@pytest.fixture
def report(tmp_path: Path) -> Path:
    (tmp_path / "secret.txt").write_text("secret")
    path = tmp_path / "report.html"
    path.write_text("<p>report</p>")
    return path


def ask(
    url: str, target: str = "/", method: str = "GET", host: str | None = None
) -> tuple[int, bytes]:
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(str(parts.hostname), parts.port, timeout=5)
    try:
        connection.request(method, target, headers={"Host": host or parts.netloc})
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def test_report_is_served_and_nothing_beside_it(report: Path) -> None:
    with ReportServer(report) as server:
        assert ask(server.url) == (200, b"<p>report</p>")
        assert ask(server.url, method="HEAD") == (200, b"")
        for target in ("/secret.txt", "/../secret.txt", "/report.html", "//etc/passwd", "/%2e%2e"):
            assert ask(server.url, target)[0] == 404, target
        assert ask(server.url, method="POST")[0] == 501
        report.write_text("<p>again</p>")
        assert ask(server.url) == (200, b"<p>again</p>")
        report.unlink()
        assert ask(server.url)[0] == 404


def test_pages_of_other_hosts_are_turned_away(report: Path) -> None:
    with ReportServer(report) as server:
        assert ask(server.url, host="evil.example")[0] == 403


def test_only_the_loopback_address_answers(report: Path) -> None:
    with ReportServer(report) as server:
        port = urlsplit(server.url).port
        assert port is not None
        assert urlsplit(server.url).hostname == "127.0.0.1"
        with (
            pytest.raises(OSError, match="refused"),
            socket.create_connection(("127.0.0.2", port), timeout=2),
        ):
            pass  # an address that only a server on all interfaces answers


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_it_cleanly(report: Path, number: signal.Signals) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", SERVE, str(report)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        url = process.stdout.readline().decode().strip()
        assert ask(url)[0] == 200
        process.send_signal(number)
        _, error = process.communicate(timeout=10)
    assert process.returncode == 0
    assert error == b""
    with pytest.raises(ConnectionRefusedError):
        ask(url)


def test_missing_report_is_named(tmp_path: Path) -> None:
    with pytest.raises(rpctl.RpctlError, match=r"none\.html"):
        ReportServer(tmp_path / "none.html")
