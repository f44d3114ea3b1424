"""A page that asks for a motion to its goal: what is refused, and that the robot gets there."""

from __future__ import annotations

import json
import os
import signal
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.errors import RpctlError
from rpctl.view.serve.go import GoServer, ending, read_request
from rpctl.view.serve.server import GO, STOP
from tests.leaning import leaning
from tests.view.chromium import opened, wait
from tests.view.serve.test_live import PATIENCE, command
from tests.view.serve.test_server import ask, listen, post

FINE: dict[str, Any] = {
    "start": [0.5, -0.5, 1.0],
    "posture": {"arm_revolute_joint": 0.1, "arm_prismatic_joint": 0.5},
    "goal": [0.5, -0.5, 1.0],
    "arm": {"arm_revolute_joint": 0.3},
    "kinematic": "unified",
}


def test_request_is_what_the_page_says(paper: Robot) -> None:
    request = read_request(paper, FINE)
    assert request.start == (0.5, -0.5, 1.0)
    assert request.posture == {"arm_revolute_joint": 0.1, "arm_prismatic_joint": 0.5}
    assert (request.goal, request.arm) == ((0.5, -0.5, 1.0), {"arm_revolute_joint": 0.3})
    assert read_request(paper, {**FINE, "goal": None}).goal is None


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": [0.0, 0.0, "0"]}, "start: is '0'"),
        ({"start": [0.0, 0.0, float("inf")]}, "start is inf"),
        ({"goal": [0.0, True, 0.0]}, "goal: is True"),
        ({"goal": [0.0, 2e4, 0.0]}, "goal is 20000; give"),
        ({"posture": {"arm_revolute_joint": 0.1}}, "posture: give all joints"),
        ({"posture": {**FINE["posture"], "arm_prismatic_joint": 9.0}}, "begins at 9, beyond its"),
        ({"arm": {"arm_revolute_joint": None}}, "arm_revolute_joint: is None"),
        ({"arm": {"wheel_left_joint": 0.0}}, "joint of the arm 'wheel_left_joint' is not known"),
        ({"kinematic": "unifed"}, '"unifed"; give unified'),
        ({"more": 1}, "setting 'more' is not known"),
    ],
)
def test_request_of_another_form_is_refused(
    paper: Robot, change: dict[str, Any], message: str
) -> None:
    with pytest.raises(RpctlError, match=message):
        read_request(paper, {**FINE, **change})


@pytest.mark.parametrize("asked", [None, [], "go", {"goal": [0, 0, 0]}])
def test_request_that_is_none_is_refused(paper: Robot, asked: object) -> None:
    with pytest.raises(RpctlError, match="missing: start"):
        read_request(paper, asked)


def served(server: GoServer, act: Callable[[str], object]) -> None:
    """Serve a page from the main thread while another one uses it, then end it by Ctrl-C."""
    faults: list[BaseException] = []

    def use(url: str) -> None:
        try:
            act(url)
        except BaseException as error:
            faults.append(error)
        os.kill(os.getpid(), signal.SIGINT)

    threads: list[threading.Thread] = []

    def ready(url: str) -> None:
        threads.append(threading.Thread(target=use, args=(url,)))
        threads[0].start()

    server.run(ready)
    threads[0].join()
    assert not faults, faults


def until_end(url: str) -> tuple[list[str], dict[str, Any]]:
    """Return the kinds of the events of a motion, and what the last one says."""
    events, kinds = listen(url, seconds=PATIENCE), []
    while True:
        line = events.readline().decode()
        assert line, "the stream ended"
        if line.startswith("event: "):
            kinds.append(line.split()[1])
        if kinds and kinds[-1] == "end" and line.startswith("data: "):
            events.close()
            return kinds, json.loads(line[6:])


@pytest.mark.slow
def test_robot_goes_where_its_page_says_and_says_how_near_it_came(paper: Robot) -> None:
    """The arm only: a short way. Meanwhile a second request is refused; Stop ends another one."""

    def act(url: str) -> None:
        assert post(url, json.dumps(FINE).encode())[0] == 409  # nobody has seen the robot
        assert ask(url)[0] == 200
        assert post(url, json.dumps({**FINE, "goal": [0, 0, 0, 0]}).encode())[0] == 409
        assert post(url, json.dumps(FINE).encode(), GO) == (200, b"")
        status, text = post(url, json.dumps(FINE).encode(), GO)
        assert (status, text) == (409, b"the robot is already moving; stop it first")
        kinds, end = until_end(url)
        assert kinds[0] == "begin"
        assert kinds.count("frame") == kinds.count("figures") > 20
        assert end["text"].startswith("Reached in ")
        assert end["bad"] is False
        far = {**FINE, "goal": [100.0, -0.5, 1.0]}
        assert post(url, json.dumps(far).encode())[0] == 200
        events = listen(url)
        while not events.readline().startswith(b"event: frame"):
            pass
        assert post(url, b"null", STOP)[0] == 200
        assert until_end(url)[1] == {"text": "Stopped.", "bad": False}

    served(GoServer(lambda: paper), act)


def test_robot_that_leans_is_shown_and_goes_nowhere() -> None:
    def act(url: str) -> None:
        assert ask(url)[0] == 200
        status, text = post(url, json.dumps(FINE).encode(), GO)
        assert status == 409 and b"balancer leans on two wheels" in text

    served(GoServer(lambda: leaning("balancer")), act)


def test_ending_says_how_near_it_came(paper: Robot) -> None:
    """The base ends 30 mm and 40 mrad short of a goal elsewhere: the figures of the sentence."""
    run = rpctl.track(paper, "goal 0,0,0 arm_revolute_joint=0.001", duration=0.01)
    away = {**FINE, "start": [0, 0, 0], "goal": [0.018, -0.024, 0.04]}
    near = {**FINE, "start": [0, 0, 0], "goal": [0.0, 0.01, 0.0]}
    text = ending(run, read_request(paper, away))
    assert text.startswith("Not reached in 0.0 s: 30.0 mm and 40.0 mrad from the goal; the end eff")
    assert ending(run, read_request(paper, near)).startswith("Reached in 0.0 s: 10.0 mm and 0.0")


@pytest.mark.slow
def test_go_is_watched_in_the_page(browser: Any, paper: Robot, tmp_path: Path) -> None:
    """Sliders and handles rest meanwhile; in the end the robot stands where its goal is."""
    with command("view", "paper", folder=tmp_path) as (_, url), opened(browser, url, url) as page:
        page.get_by_role("button", name="Set a goal").click()
        page.get_by_label("x, m").fill("0.4")
        page.get_by_label("Kinematic law").select_option("kanayama")
        assert page.locator("#goal-command").inner_text().endswith("--kinematic kanayama")
        page.get_by_label("Kinematic law").select_option("unified")
        assert "--kinematic" not in page.locator("#goal-command").inner_text()
        page.evaluate("rpctl.goal.drag('hand', [1.3, 0.3, 0.7])")
        page.get_by_role("button", name="Go", exact=True).click()
        wait(page, "rpctl.time > 0.5")
        assert page.locator("#sliders").evaluate("(box) => box.inert")
        assert page.evaluate("rpctl.goal.state().running")
        assert page.locator("#live .uplot").count() == 2
        wait(page, "!rpctl.goal.state().running")
        assert page.locator("#status").inner_text().startswith("Reached in")
        state = page.evaluate("rpctl.goal.state()")
        assert page.evaluate("rpctl.base")[:2] == pytest.approx(state["pose"][:2], abs=5e-3)
        arm = [paper.moving_joint_names.index(name) for name in paper.joint_names]
        values = np.array(page.evaluate("rpctl.values"))[arm]
        assert values == pytest.approx(np.array(state["values"])[arm], abs=5e-3)
        assert not page.locator("#sliders").evaluate("(box) => box.inert")
