"""Commands that serve a page: what a browser sees of them, and how they end."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import Robot, RpctlError, Run
from rpctl.reference.motion import ReferenceState
from rpctl.reference.named import reference_by_name
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.loop.recorder import LoopSample
from rpctl.simulation.loop.track import simulate
from rpctl.view.pages.robot_page import LiveMotion, robot_page
from rpctl.view.serve import live
from rpctl.view.serve import server as streams
from rpctl.view.serve.live import Broadcast
from rpctl.view.serve.server import PageServer, Stream
from tests.grids import cells
from tests.leaning import leaning
from tests.view.chromium import changed, opened, picture, wait
from tests.view.samples import write_gripper
from tests.view.serve.test_server import ask, listen, post

PATIENCE = 120  # s; the machine may have much else to do
VIEWER = "rpctl.scene.viewer"
SIGNALS = [signal.SIGINT, signal.SIGTERM]
VIEWS = list(product(("robot", "run"), SIGNALS))
QUICK_VIEWS = {("robot", signal.SIGTERM)}


@contextmanager
def command(*words: str, folder: Path) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run a command until it is left; yields it and the URL that it printed."""
    process = subprocess.Popen(
        [sys.executable, "-m", "rpctl", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(Path(rpctl.__file__).parents[1])},
    )
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if found := re.search(r"http://127\.0\.0\.1:\d+/[\w-]+/", line):
                yield process, found.group()
                break
        else:
            pytest.fail(f"no URL: {process.communicate()}")
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def children(process: subprocess.Popen[str]) -> list[str]:
    """Return the processes that it has started, by number: the reader of meshes, at most."""
    tasks = Path(f"/proc/{process.pid}/task")
    found = "".join(file.read_text() for file in tasks.glob("*/children")).split()
    assert len(found) <= 1
    return found


def are_gone(numbers: list[str]) -> bool:
    """Return whether processes end within a time."""
    until = time.monotonic() + PATIENCE
    while any(Path(f"/proc/{number}").exists() for number in numbers):
        if time.monotonic() > until:
            return False
        time.sleep(0.01)
    return True


@pytest.mark.parametrize(("what", "number"), cells(VIEWS, (), QUICK_VIEWS))
def test_signals_end_a_view(
    number: signal.Signals, what: str, paper_run: Run, tmp_path: Path
) -> None:
    paper_run.save(tmp_path / "run.npz")
    words = ("view", "paper" if what == "robot" else ".")
    with command(*words, folder=tmp_path) as (process, url):
        assert ask(url)[0] == 200
        started = children(process)
        process.send_signal(number)
        _, error = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0
    assert are_gone(started)
    assert len(error.splitlines()) == (0 if what == "robot" else 2)  # what is missing, and drawn
    with pytest.raises(ConnectionRefusedError):
        ask(url)


@pytest.mark.parametrize("number", cells(SIGNALS, (), {signal.SIGINT}))
def test_signals_end_a_simulation_that_is_watched(number: signal.Signals, tmp_path: Path) -> None:
    words = ("track", "paper", "--live", "--samples", "0", "--duration", "600", "--out", "out")
    with command(*words, folder=tmp_path) as (process, url):
        assert ask(url)[0] == 200
        started = children(process)
        process.send_signal(number)
        _, error = process.communicate(timeout=PATIENCE)
    assert (process.returncode, error) == (130, "interrupted\n")
    assert are_gone(started)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ConnectionRefusedError):
        ask(url)


@pytest.mark.slow
@pytest.mark.parametrize("how", ["signal", "button"])
def test_simulation_that_is_watched_and_ended_leaves_its_run(how: str, tmp_path: Path) -> None:
    words = ("track", "paper", "--live", "--samples", "0", "--duration", "600", "--out", "out")
    with command(*words, folder=tmp_path) as (process, url):
        assert ask(url)[0] == 200
        events = listen(url, seconds=PATIENCE)
        while not (line := events.readline().decode()).startswith("data: [0.5"):
            assert line, "the stream ended"
        if how == "signal":
            process.send_signal(signal.SIGINT)
        else:
            assert post(url, b"null", streams.STOP)[0] == 200
        rest = [events.readline().decode()]
        while rest[-1] and rest[-1] != "event: done\n":
            rest.append(events.readline().decode())
        assert ask(url)[1].find(b"ended at 0.") > 0  # the page's place is the report's
        _, error = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    kept, last = error.splitlines()
    assert re.fullmatch(
        r"ended at 0\.\d+ of 600 s \(interrupted\); the samples until then are kept: "
        r"out/report.html",
        kept,
    )
    assert last == "interrupted"
    assert any('"Ended; the report is being written' in line for line in rest)
    out = tmp_path / "out"
    assert {file.name for file in out.iterdir()} == {
        "run.npz", "summary.json", "tracking.png", "report.html",
    }  # fmt: skip
    run = Run.load(out / "run.npz")
    assert 0.5 <= run.t[-1] < 5.0
    assert json.loads((out / "summary.json").read_text())["duration"] == run.t[-1]
    assert run.notes[-1] in (out / "report.html").read_text()


def test_simulation_is_seen_and_leaves_its_run(browser: Any, tmp_path: Path) -> None:
    words = ["track", "paper", "--live", "--samples", "0", "--duration", "12", "--out", "out"]
    error = ["--initial-error", "0.3,0.3,0.4"]
    with (
        command(*words, *error, folder=tmp_path) as (process, url),
        opened(browser, url, url) as page,
    ):
        wait(page, "rpctl.time > 0.2")
        page.get_by_label("Names").uncheck()
        first, then = picture(page, VIEWER), page.evaluate("rpctl.time")
        wait(page, f"rpctl.time > {then + 1.0}")
        assert changed(picture(page, VIEWER), first) > 200
        assert not (tmp_path / "out/run.npz").exists()  # it still simulates
        assert "of 12 s · base error" in page.locator("#status").inner_text()
        assert page.get_by_label("arm_revolute_joint").is_disabled()
        page.reload()
        wait(page, f"window.rpctl && window.rpctl.time > {then}")
        page.wait_for_selector("#scrubber")  # the report has taken the page's place
        out, err = process.communicate(timeout=PATIENCE)
        wait(page, "window.rpctl && window.rpctl.ready")
    assert (process.returncode, err) == (0, "")
    assert "report.html" in out
    assert Run.load(tmp_path / "out/run.npz").t[-1] == pytest.approx(12.0)


class Unopened(PageServer):
    """A server whose page nobody opens, and for which nobody has to wait."""

    def __init__(self) -> None:
        pass

    def wait_delivered(self, count: int, seconds: float) -> bool:
        return False


def frames(stream: Stream) -> list[list[float]]:
    stream.close()
    log = b"".join(stream.events()).decode().split("\n\n")
    return [json.loads(e.partition("data: ")[2]) for e in log if "event: frame" in e]


def test_frames_are_what_is_simulated(tmp_path: Path) -> None:
    robot = rpctl.load(write_gripper(tmp_path), free="*", root="planar")
    stream = Stream()
    watcher = Broadcast(robot, Unopened(), stream, 1.0)
    settings = RunSettings("eight", 1.0, (0.1, -0.2, 0.3))
    run = simulate(robot, Config(run=settings), watch=watcher)
    sent = frames(stream)
    assert sent[0][0] == 0.0
    assert sent[-1][0] == pytest.approx(1.0)
    assert 0.9 * live.FRAME_RATE < len(sent) <= live.FRAME_RATE + 2
    for t, count, *rest in (sent[0], sent[11], sent[-1]):
        sample = int(np.argmin(np.abs(run.t - t)))
        halves = rest[: int(count)], rest[int(count) :]
        for (x, y, theta, *positions), q in zip(halves, (run.q, run.q_ref), strict=True):
            joints = dict(zip(robot.model.names[2:], positions, strict=True))
            shown = robot.configuration(x, y, theta, joints=joints)
            wheels = [
                robot.model.joints[robot.model.getJointId(w.joint)] for w in robot.drive.wheels
            ]
            if q is run.q_ref:  # the wheels of the ghost are those of the robot
                for joint in wheels:
                    at = slice(joint.idx_q, joint.idx_q + joint.nq)
                    shown[at] = q[sample][at]
            assert shown == pytest.approx(q[sample], abs=2e-5)
            assert joints["right_finger_joint"] == pytest.approx(
                0.1 - 0.5 * joints["left_finger_joint"], abs=2e-5
            )


@pytest.mark.slow
@pytest.mark.quick
def test_page_draws_robot_ghost_and_trail_where_they_are(
    browser: Any, tricycle: Robot, golden: Run
) -> None:
    """The trail is the robot's, the ghost its reference's: they are far apart here."""
    stream, still = Stream(), np.zeros(2)
    watcher = Broadcast(tricycle, Unopened(), stream, 1.0)
    for k, t in enumerate(golden.t):
        twist = np.array([0.5, 0.0, -0.1])  # P is 0.8 m behind the wheel that steers
        pose, joints = golden.base_ref[k], golden.joints_ref[k]
        state = ReferenceState(pose, twist, np.zeros(3), joints, still, still)
        watcher(LoopSample(t, golden.q[k], golden.log.e[k], golden.tau[k], state))
    text = robot_page(tricycle, LiveMotion(golden.q[0], golden.base_ref, 0.5)).encode()
    joints = [tricycle.model.getJointId(f"{name}_joint") for name in ("steer", "swing", "slide")]
    with PageServer(lambda: text, stream) as server, opened(browser, server.url) as page:
        wait(page, "rpctl.time >= 0.5")
        drawn = page.evaluate(
            """(joints) => { const place = (name) => { const node = rpctl.scene.node(name);
              node.updateWorldMatrix(true, false); return node.matrixWorld.elements; };
            const trail = rpctl.scene.node("trail-live").geometry;
            return { robot: joints.map((j) => place(`robot-${j}`)),
              ghost: joints.map((j) => place(`reference-${j}`)), count: trail.drawRange.count,
              trail: Array.from(trail.attributes.position.array.slice(0, 36)) }; }""",
            joints,
        )
        said = page.locator("#status").inner_text()
    assert drawn["count"] == 6 * (len(golden.t) - 1)
    trail = np.array(drawn["trail"]).reshape(-1, 2, 3).mean(axis=1)
    assert trail[:, :2] == pytest.approx(golden.log.base[:, :2], abs=1e-5)
    data, wanted = tricycle.model.createData(), golden.q_ref[-1].copy()
    tricycle.set_joint(wanted, "steer_joint", float(np.arctan(0.8 * -0.1 / 0.5)))
    upright = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    for shown, q in ((drawn["robot"], golden.q[-1]), (drawn["ghost"], wanted)):
        pin.forwardKinematics(tricycle.model, data, q)
        for elements, joint in zip(shown, joints, strict=True):
            pose = upright @ np.array(elements).reshape(4, 4).T
            assert pose == pytest.approx(data.oMi[joint].homogeneous, abs=1e-4)
    gap = 1e3 * np.linalg.norm(golden.log.base[-1, :2] - golden.base_ref[-1, :2])
    assert said == f"0.5 of 0.5 s · base error {gap:.1f} mm"


def test_simulation_that_is_watched_keeps_to_real_time(
    paper: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = [100.0]

    def sleep(seconds: float) -> None:
        assert seconds >= 0.0, "time.sleep refuses less"
        clock[0] += seconds

    for module in (live, streams):
        monkeypatch.setattr(
            module, "time", SimpleNamespace(monotonic=lambda: clock[0], sleep=sleep)
        )
    stream = Stream()
    state = reference_by_name(paper, "line")(0.0)
    watcher = Broadcast(paper, Unopened(), stream, 10.0)
    q, e, tau = paper.configuration(), np.zeros(5), np.zeros(4)
    for t in (0.0, 0.1):
        watcher(LoopSample(t, q, e, tau, state))
    assert clock[0] == 100.0  # nobody watches
    with stream.reading():
        for t in (0.2, 0.3, 0.5):
            watcher(LoopSample(t, q, e, tau, state))
        assert clock[0] == pytest.approx(100.3)
        clock[0] += 5.0  # the simulation was slow: it does not hurry afterwards
        for t in (0.6, 0.7):
            watcher(LoopSample(t, q, e, tau, state))
        assert clock[0] == pytest.approx(105.4)


@pytest.mark.parametrize("seed", range(3))
def test_rounding_never_asks_for_a_negative_pause(
    paper: Robot, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    pauses: list[float] = []
    clock = [rng.uniform(1.0, 5.0)]  # s since the machine was started
    fake = SimpleNamespace(monotonic=lambda: clock[0], sleep=pauses.append)
    monkeypatch.setattr(live, "time", fake)
    stream = Stream()
    watcher = Broadcast(paper, Unopened(), stream, 1e3, awaits=False)
    state = reference_by_name(paper, "line")(0.0)
    q, e, tau = paper.configuration(), np.zeros(5), np.zeros(4)
    with stream.reading():
        for t in 100.0 + np.cumsum(rng.uniform(0.04, 0.05, 200)):  # the page was opened late
            watcher(LoopSample(t, q, e, tau, state))
            clock[0] += rng.uniform(0.05, 0.06)  # slower than real time: the pause is 0, rounded
    assert len(pauses) == 200
    assert min(pauses) >= 0.0


def test_a_robot_that_leans_is_not_watched_live() -> None:
    robot = leaning("balancer")
    with (
        pytest.raises(RpctlError, match="balancer leans on two wheels"),
        live.broadcast(robot, reference_by_name(robot, "line"), 1.0, print),
    ):
        pass
