"""What a page may do: its policy, and attacks on it in a real browser."""

from __future__ import annotations

import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from typing import Any

import pytest

from rpctl import Robot, Run
from rpctl.equivalence.scope import Scope
from rpctl.equivalence.verify import Certificate
from rpctl.view import film as notebook
from rpctl.view.pages.certificate import write_certificate
from rpctl.view.pages.report import write_report
from rpctl.view.pages.robot_page import robot_page
from rpctl.view.scene.scene import build_scene
from rpctl.view.serve.server import PageServer, Stream
from tests.grids import cells
from tests.view.chromium import WINDOW, wait
from tests.view.pages.pages import bare_scene, goal_page, waiting_page

SERVED = ("waiting", "goal")
KINDS = ("report", "comparison", "robot", "scene", "notebook", "certificate", *SERVED)
ELSEWHERE = "https://elsewhere.example/"
ATTACK = f"""<script>window.hacked = "script"</script>
<img src="x" onerror="window.hacked = 'handler'"><img src="{ELSEWHERE}seen.png">
<base href="{ELSEWHERE}"><iframe src="{ELSEWHERE}frame"></iframe>
<style>@import "{ELSEWHERE}style.css";</style>
<form id="attack" action="{ELSEWHERE}form" method="post"><input name="a" value="b"></form>"""
SEND = "() => document.getElementById('attack').submit()"
FETCH = f"() => fetch('{ELSEWHERE}fetched').then(() => true, () => false)"


@pytest.fixture
def pages(cart: Robot, cart_run: Run, tmp_path: Path) -> dict[str, str]:
    def written(path: Path) -> str:
        return path.read_text(encoding="utf-8")

    framed = unescape(notebook.show(cart_run).partition('srcdoc="')[2].partition('" style')[0])
    both = write_report([cart_run, cart_run], tmp_path / "both.html", names=["a", "b"])
    return {
        "report": written(write_report(cart_run, tmp_path / "report.html", robot=cart)),
        "comparison": written(both),
        "robot": robot_page(cart),
        "scene": bare_scene(build_scene(cart, cart_run)),
        "notebook": framed,
        "certificate": written(
            write_certificate(
                Certificate(
                    robot="cart", samples=1, seed=0, checks=(), scope=Scope("all", (), (), None)
                ),
                tmp_path / "c",
            )
        ),
        "waiting": waiting_page(cart),
        "goal": goal_page(cart),
    }


def rules(page: str) -> dict[str, list[str]]:
    """Return the rules of a page's policy by name; the policy stands before all that it rules."""
    before, tag, rest = page.partition('<meta http-equiv="Content-Security-Policy" content="')
    assert tag
    assert not re.search("<(script|style|link|img|base|body)", before)
    listed = [rule.split() for rule in rest.partition('"')[0].split(";")]
    assert len({name for name, *_ in listed}) == len(listed)
    return {name: values for name, *values in listed}


def test_every_page_forbids_what_it_does_not_need(pages: dict[str, str]) -> None:
    assert tuple(pages) == KINDS
    for kind, page in pages.items():
        found = rules(page)
        scripts = found.pop("script-src")
        assert all(each.startswith("'sha256-") for each in scripts) or scripts == ["'none'"], kind
        assert (scripts == ["'none'"]) is (kind == "certificate")
        assert found == {
            "default-src": ["'none'"],
            "style-src": ["'unsafe-inline'"],
            "img-src": ["data:", "blob:"],
            "connect-src": ["'self'" if kind in SERVED else "'none'"],
            "base-uri": ["'none'"],
            "form-action": ["'none'"],
        }, kind


class Visit:
    """A page that was opened and attacked: what it did, and what it was forbidden."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.asked: list[str] = []  # of elsewhere
        self.forbidden: list[str] = []
        self.base: str | None = None
        self.hacked: str | None = None
        page.on("console", lambda said: self.forbidden.append(said.text))
        page.route(f"{ELSEWHERE}**", self._answer)

    def _answer(self, route: Any) -> None:
        self.asked.append(route.request.url.removeprefix(ELSEWHERE))
        route.fulfill(status=204)

    def attack(self, url: str) -> None:
        """Open a page, wait for what was injected, fetch from elsewhere and send the form."""
        self.page.goto(url)
        wait(self.page, "document.getElementById('attack')")
        self.page.evaluate(FETCH)
        self.page.evaluate(SEND)
        self.page.wait_for_timeout(300)
        self.base = self.page.evaluate("document.baseURI")
        self.hacked = self.page.evaluate("window.hacked")

    def attack_file(self, text: str, folder: Path) -> None:
        """Open and attack a page that lies in a file."""
        file = folder / "attacked.html"
        file.write_text(text, encoding="utf-8")
        self.attack(file.as_uri())

    def attack_server(self, text: str) -> None:
        """Open and attack a page that is served; it hears its server nevertheless."""
        stream = Stream()
        with PageServer(text.encode, stream) as server:
            stream.send("state", "the server was heard")
            self.attack(server.url)
            wait(self.page, "document.body.innerText.includes('the server was heard')")


@pytest.fixture
def visit(browser: Any) -> Iterator[Visit]:
    context = browser.new_context(viewport=WINDOW)
    yield Visit(context.new_page())
    context.close()


def attacked(page: str) -> str:
    """Return a page with what a name would bring that was not escaped."""
    before, tag, after = page.rpartition("</body>")
    return f"{before}{ATTACK}{tag}{after}"


@pytest.mark.parametrize("kind", cells(KINDS, slow=["report", "notebook", "goal"]))
def test_what_gets_into_a_page_does_nothing_there(
    visit: Visit, pages: dict[str, str], kind: str, tmp_path: Path
) -> None:
    """Nothing is run, fetched, framed, sent or turned elsewhere; the page itself works."""
    if kind in SERVED:
        visit.attack_server(attacked(pages[kind]))
    else:
        visit.attack_file(attacked(pages[kind]), tmp_path)
    assert visit.asked == []
    assert visit.hacked is None
    assert visit.base == visit.page.url
    said = " ".join(visit.forbidden)
    for rule in ("script-src", "img-src", "base-uri", "form-action", "style-src", "connect-src"):
        assert f"{rule} " in said, (rule, said)
    if kind not in ("certificate", "notebook"):
        wait(visit.page, "window.rpctl && window.rpctl.ready")


@pytest.mark.slow
@pytest.mark.parametrize("rule", ["script-src", "connect-src", "base-uri", "form-action"])
def test_each_rule_holds_off_what_no_other_one_does(
    visit: Visit, cart: Robot, rule: str, tmp_path: Path
) -> None:
    page = re.sub(rf"{rule} [^;\"]*;? ?", "", attacked(robot_page(cart)), count=1)
    if rule in ("script-src", "connect-src"):
        page = page.replace("default-src 'none'; ", "")
    visit.attack_file(page, tmp_path)
    through = {
        "script-src": visit.hacked is not None,
        "connect-src": "fetched" in visit.asked,
        "base-uri": visit.base == ELSEWHERE,
        "form-action": "form" in visit.asked,
    }
    assert [name for name, passed in through.items() if passed] == [rule]


@pytest.mark.slow
def test_a_served_page_cannot_be_framed(visit: Visit, cart: Robot, tmp_path: Path) -> None:
    with PageServer(robot_page(cart).encode) as server:
        outer = tmp_path / "outer.html"
        outer.write_text(f'<iframe src="{server.url}"></iframe>', encoding="utf-8")
        visit.page.goto(outer.as_uri())
        visit.page.wait_for_timeout(500)
        assert not visit.page.frames[1].evaluate("Boolean(window.rpctl)")
        assert "frame-ancestors" in " ".join(visit.forbidden)
