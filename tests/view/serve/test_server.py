from __future__ import annotations

import http.client
import socket
import threading
import time
from collections.abc import Iterator
from http.server import ThreadingHTTPServer
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from rpctl.errors import RpctlError
from rpctl.view.serve import server as streams
from rpctl.view.serve.server import EVENTS, PageServer, Stream


@pytest.fixture
def report(tmp_path: Path) -> Path:
    (tmp_path / "secret.txt").write_text("secret")
    path = tmp_path / "report.html"
    path.write_text("<p>report</p>")
    return path


@pytest.fixture
def server(report: Path) -> Iterator[PageServer]:
    with PageServer(report.read_bytes) as server:
        yield server


def ask(
    url: str, target: str = "", method: str = "GET", host: str | None = None
) -> tuple[int, bytes]:
    """Ask for a place below a server's address, or, if it begins with a slash, beside it."""
    answer = request(url, target, method, host)
    return answer.status, answer.read()


def request(
    url: str, target: str = "", method: str = "GET", host: str | None = None
) -> http.client.HTTPResponse:
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(str(parts.hostname), parts.port, timeout=5)
    path = target if target.startswith("/") else parts.path + target
    connection.request(method, path, headers={"Host": host or parts.netloc, "Connection": "close"})
    return connection.getresponse()


def listen(url: str, last: str | None = None, seconds: float = 5.0) -> http.client.HTTPResponse:
    parts = urlsplit(url)
    connection = http.client.HTTPConnection(str(parts.hostname), parts.port, timeout=seconds)
    headers = {"Host": parts.netloc} | ({"Last-Event-ID": last} if last is not None else {})
    connection.request("GET", f"{parts.path}{EVENTS}", headers=headers)
    return connection.getresponse()


def event(answer: http.client.HTTPResponse) -> list[str]:
    """Return the next event, line by line."""
    lines = []
    while line := answer.readline().decode().rstrip("\n"):
        lines.append(line)
    return lines


def test_page_is_served_and_nothing_beside_it(server: PageServer, report: Path) -> None:
    assert ask(server.url) == (200, b"<p>report</p>")
    assert request(server.url).getheader("Content-Length") == "13"  # a page that breaks off is told
    for target in (
        "secret.txt", "../secret.txt", "report.html", "/etc/passwd", "%2e%2e", "events", "?", "#",
    ):  # fmt: skip
        assert ask(server.url, target)[0] == 404, target
    assert ask(server.url, method="PUT")[0] == 501
    report.write_text("<p>again</p>")
    assert ask(server.url) == (200, b"<p>again</p>")
    report.unlink()
    assert ask(server.url)[0] == 404


def test_what_is_wrong_with_a_robot_is_what_the_page_says() -> None:
    def page() -> bytes:
        raise RpctlError("robot.urdf:3: error: <b> is no mass")

    with PageServer(page) as server:
        assert ask(server.url) == (409, b"robot.urdf:3: error: <b> is no mass")


def test_pages_of_other_hosts_are_turned_away(server: PageServer) -> None:
    assert ask(server.url, host="evil.example")[0] == 403


def post(url: str, content: bytes, place: str = "go", **headers: str | None) -> tuple[int, bytes]:
    """Send what a page asks for; headers that are None are left out."""
    parts = urlsplit(url)
    sent = {
        "Host": parts.netloc,
        "Origin": f"http://{parts.netloc}",
        "Content-Type": "application/json",
        **{name.replace("_", "-"): value for name, value in headers.items()},
    }
    connection = http.client.HTTPConnection(str(parts.hostname), parts.port, timeout=5)
    try:
        kept = {name: value for name, value in sent.items() if value is not None}
        path = place if place.startswith("/") else parts.path + place
        connection.request("POST", path, body=content, headers=kept)
        answer = connection.getresponse()
        return answer.status, answer.read()
    finally:
        connection.close()


def test_only_its_own_page_can_ask_for_something() -> None:
    asked: list[object] = []

    def act(value: object) -> None:
        asked.append(value)
        if value == "no":
            raise RpctlError("it cannot go there")

    with PageServer(lambda: b"", actions={"go": act}) as server:
        assert post(server.url, b'{"goal": [1.5]}') == (200, b"")
        assert asked == [{"goal": [1.5]}]
        assert post(server.url, b'"no"') == (409, b"it cannot go there")
        asked.clear()
        for origin in (
            None,
            "null",
            "http://evil.example",
            "https://" + urlsplit(server.url).netloc,
        ):
            assert post(server.url, b"1", Origin=origin)[0] == 403, origin
        assert post(server.url, b"1", Host="evil.example", Origin="http://evil.example")[0] == 403
        assert post(server.url, b"1", Content_Type="text/plain")[0] == 415
        assert post(server.url, b"1", place="")[0] == 404
        for content in (b"{", b"NaN", b"[Infinity]", b"\xff", b"[" * 60_000):
            assert post(server.url, content)[0] == 400, content[:9]
        assert post(server.url, b" " * 65_537)[0] == 413
        assert post(server.url, b"1", Content_Length="-1")[0] == 413
        assert asked == []


def test_who_was_not_given_the_address_reads_and_stops_nothing() -> None:
    """Every user of the machine can connect: page, events and actions lie below the token."""
    asked: list[object] = []
    stream = Stream()
    stream.send("frame", "robot 7")
    with PageServer(lambda: b"robot 7", stream, {"stop": asked.append}) as server:
        token = urlsplit(server.url).path.strip("/")
        wrong = "/" + ("b" if token[-1] == "a" else "a").join((token[:-1], ""))
        for place in ("/", "//", f"/{token}", f"/{token[:-1]}/", f"/{token}a/", f"{wrong}/"):
            for target in (place, f"{place}events", f"{place}stop"):
                answers = [ask(server.url, target), post(server.url, b"null", target)]
                assert {status for status, _ in answers} == {404}, target
                assert not any(b"robot 7" in text for _, text in answers), target
        assert b"the whole address" in ask(server.url, "/")[1]
        assert said(server.url, b"GET /\xe9/ HTTP/1.0").startswith(b"HTTP/1.0 404 ")
        assert asked == []
        assert server.delivered == stream.readers == 0
        assert post(server.url, b"null", "stop")[0] == 200
        assert asked == [None]


def said(url: str, line: bytes) -> bytes:
    """Return what is answered to a request line as it stands."""
    parts = urlsplit(url)
    with socket.create_connection((str(parts.hostname), int(parts.port or 0)), 5.0) as client:
        client.sendall(line + f"\r\nHost: {parts.netloc}\r\n\r\n".encode())
        return client.makefile("rb").read()


def test_every_server_has_a_token_that_cannot_be_guessed() -> None:
    tokens = set()
    for _ in range(3):
        with PageServer(lambda: b"") as server:
            tokens.add(urlsplit(server.url).path.strip("/"))
    assert len(tokens) == 3
    assert {len(token) for token in tokens} == {32}  # 6 bits a letter: 192


def test_a_guess_is_compared_in_constant_time(
    server: PageServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared: list[tuple[bytes, bytes]] = []

    def compare(a: bytes, b: bytes) -> bool:
        compared.append((a, b))
        return a == b

    monkeypatch.setattr("hmac.compare_digest", compare)
    ask(server.url, "/guess/")
    assert compared == [(b"guess", urlsplit(server.url).path.strip("/").encode())]


def test_every_answer_keeps_the_address_to_itself_and_its_page_out_of_frames(
    server: PageServer, report: Path
) -> None:
    def answers() -> list[http.client.HTTPResponse]:
        odd = [request(server.url, host="evil.example"), request(server.url, method="PUT")]
        return [request(server.url), request(server.url, "/"), request(server.url, "x"), *odd]

    found = answers()
    report.unlink()
    found.append(request(server.url))
    assert [answer.status for answer in found] == [200, 404, 404, 403, 501, 404]
    for answer in found:
        assert answer.getheader("Referrer-Policy") == "no-referrer"
        assert answer.getheader("Cache-Control") == "no-store"
        assert answer.getheader("X-Content-Type-Options") == "nosniff"
        assert answer.getheader("Cross-Origin-Opener-Policy") == "same-origin"
        assert answer.getheader("Cross-Origin-Resource-Policy") == "same-origin"
        policy = (answer.getheader("Content-Security-Policy") or "").split("; ")
        assert {"frame-ancestors 'none'", "base-uri 'none'", "form-action 'none'"} <= set(policy)


def test_only_the_loopback_address_answers(server: PageServer) -> None:
    port = urlsplit(server.url).port
    assert port is not None
    assert urlsplit(server.url).hostname == "127.0.0.1"
    with (
        pytest.raises(OSError, match="refused"),
        socket.create_connection(("127.0.0.2", port), timeout=2),
    ):
        pass  # an address that only a server on all interfaces answers


def test_client_that_leaves_in_the_middle_is_no_fault(capfd: pytest.CaptureFixture[str]) -> None:
    with PageServer(lambda: bytes(50_000_000)) as server:
        parts = urlsplit(server.url)
        with socket.create_connection((str(parts.hostname), int(parts.port or 0))) as client:
            client.sendall(f"GET {parts.path} HTTP/1.1\r\nHost: {parts.netloc}\r\n\r\n".encode())
            client.recv(10)
        assert server.delivered == 0
        assert ask(server.url)[0] == 200
        assert server.wait_delivered(1, 5.0)
    assert capfd.readouterr().err == ""


def test_events_come_in_order_to_all_and_again_to_one_who_comes_back() -> None:
    stream = Stream()
    with PageServer(lambda: b"", stream) as server:
        stream.send("frame", [1.5])
        early = listen(server.url)
        assert early.getheader("Content-Type") == "text/event-stream"
        assert event(early) == ["id: 0", "event: frame", "data: [1.5]"]
        stream.send("state", "two\nlines")
        assert event(early) == ["id: 1", "event: state", 'data: "two\\nlines"']
        late, again = listen(server.url), listen(server.url, last="0")
        assert event(late)[0] == "id: 0"
        assert event(late)[0] == event(again)[0] == "id: 1"
        assert stream.readers == 3
        for answer in (early, late, again):
            answer.close()


def test_events_that_are_forgotten_come_to_nobody_who_is_late() -> None:
    """Numbers go on, so that one who was there, and comes back, misses and repeats nothing."""
    stream = Stream()
    with PageServer(lambda: b"", stream) as server:
        stream.send("frame", 0)
        stream.send("frame", 1)
        early = listen(server.url)
        assert [event(early)[0], event(early)[0]] == ["id: 0", "id: 1"]
        stream.forget()
        stream.send("frame", 2)
        for answer in (early, listen(server.url), listen(server.url, last="1")):
            assert event(answer) == ["id: 2", "event: frame", "data: 2"]
            answer.close()


def test_stream_keeps_the_latest_events_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "MAX_KEPT_BYTES", 2000)
    stream = Stream()
    early = stream.events()
    stream.send("state", "first")
    assert b"first" in next(early)
    for number in range(5000):
        stream.send("state", number)
    stream.send("state", "x" * 3000)  # larger than all that is kept
    stream.send("state", "last")
    stream.close()
    kept = b"".join(stream.events())
    assert len(kept) < 2000
    assert b"last" in kept
    assert b"".join(early) == kept, "who was slow goes on with the oldest that is there"
    numbers = [int(line[4:]) for line in kept.decode().split("\n") if line.startswith("id: ")]
    assert numbers == [5002]


def test_number_of_thousands_of_digits_is_no_event(capfd: pytest.CaptureFixture[str]) -> None:
    stream = Stream()
    stream.send("state", "here")
    stream.close()
    with PageServer(lambda: b"", stream) as served:
        parts = urlsplit(served.url)
        connection = http.client.HTTPConnection(str(parts.hostname), parts.port, timeout=5)
        connection.request("GET", parts.path + EVENTS, headers={"Last-Event-ID": "9" * 5000})
        assert b"here" in connection.getresponse().read()
    assert capfd.readouterr().err == ""


def test_machine_without_a_port_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(99, "Cannot assign requested address")

    monkeypatch.setattr(ThreadingHTTPServer, "server_bind", full)
    with pytest.raises(RpctlError, match=r"127\.0\.0\.1: no page can be served here: Cannot"):
        PageServer(lambda: b"")


def test_stream_that_is_closed_ends_for_its_readers() -> None:
    stream = Stream()
    with PageServer(lambda: b"", stream) as server:
        answer = listen(server.url, last="not a number")
        stream.send("done", None)
    assert answer.read() == b"id: 0\nevent: done\ndata: null\n\n"


def test_silent_stream_notices_a_page_that_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "KEEPALIVE_S", 0.05)
    monkeypatch.setattr(streams, "RECONNECT_S", 0.2)
    stream = Stream()
    assert not stream.wait_reader(0.01)
    with PageServer(lambda: b"", stream) as server:
        answer = listen(server.url)
        assert stream.wait_reader(5.0)
        assert answer.readline() == b":\n"
        answer.close()
        until = time.monotonic() + 10.0
        while stream.readers > 0 and time.monotonic() < until:
            time.sleep(0.01)
        while stream.watched and time.monotonic() < until:  # for a moment: it may come back
            time.sleep(0.01)
        assert time.monotonic() < until


def test_page_that_does_not_read_holds_up_nobody() -> None:
    stream = Stream()
    with PageServer(lambda: b"", stream) as server:
        stuck = listen(server.url)
        for _ in range(200):
            stream.send("frame", "x" * 100_000)  # more than any buffer between holds
        assert event(listen(server.url))[1] == "event: frame"
        stuck.close()


def test_nothing_is_left_running(report: Path) -> None:
    before = threading.active_count()
    with PageServer(report.read_bytes) as server:
        url = server.url
        ask(url)
    with pytest.raises(ConnectionRefusedError):
        ask(url)
    assert threading.active_count() <= before
