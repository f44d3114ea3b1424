"""What is printed for people: every figure in the unit that stands beside it."""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

import rpctl
from rpctl import Robot, Run, summarize
from rpctl.cli import compare, inspect, verify
from rpctl.cli import summary as shown
from rpctl.equivalence.certificate import Check
from rpctl.equivalence.scope import Scope
from rpctl.equivalence.verify import Certificate
from rpctl.robot.inspection import facts
from rpctl.simulation.config import RunSettings
from rpctl.study.cells import Figures, Row, figures_of
from rpctl.study.compare import (
    COLUMNS,
    PAPER,
    PROPOSED,
    CompareCell,
    CompareRow,
    LawPair,
)
from rpctl.view.run_folder import RunFolder
from tests.golden import TRICYCLE, beside_its_path
from tests.robots import write
from tests.runs import vary
from tests.vehicles import vehicle

KANAYAMA = LawPair("kanayama", "paper")
Printed = Callable[[], list[str]]


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch) -> Printed:
    """Return what gives the lines that were printed, without the spaces of columns."""
    console = Console(width=160, record=True, file=io.StringIO(), highlight=False)
    for module in (compare, inspect, shown, verify):
        monkeypatch.setattr(module, "console", lambda: console)

    def lines() -> list[str]:
        return [" ".join(line.split()) for line in console.export_text().splitlines()]

    return lines


def test_summary_of_a_run(golden: Run, printed: Printed) -> None:
    tau, rates = np.array(golden.tau), np.array(golden.log.rates)
    tau[2:4, 3], rates[4, 4] = -25.0, 0.75
    run = beside_its_path(vary(golden, tau=tau, rates=rates))
    summary = summarize(run)
    assert summary.end_effector_path is not None
    tip = [1e3 * getattr(summary.end_effector_path, key) for key in ("rms", "final", "settled")]
    written = RunFolder(summary, Path("out/report.html"), 1_250_000, ("a note",))
    shown.show_summary(written, Path("out"))
    rms = {
        "base": (5.0, 0.5, 0.5, 0.13, 0.1, 0.05),
        "tip": (0.7, 0.3, 0.07, 0.03, 0.07, 0.03),
        "swing": (1.0, 0.5, 0.2, 0.1, 0.3, 0.2),
        "slide": (0.04, 0.03, 0.01, 0.005, 0.02, 0.01),
    }
    milli = {key: 1e3 * math.sqrt(sum(x * x for x in row) / 6) for key, row in rms.items()}
    assert printed() == [
        "late the run is too short to judge: base is up to 102 mm from its reference in its last "
        "tenth",
        "base behind its reference by 0.10 s (100 mm) at most, 0.10 s (100 mm) at the end",
        "ideal plant: the simulated robot equals the controller's model",
        "",
        "tracking error rms final largest in 2nd half largest speed",
        f"base {milli['base']:.3f} mm 50.000 mm 130.000 mm",
        "off its path 20.000 mm 20.000 mm 20.000 mm",
        f"end effector {milli['tip']:.3f} mm 30.000 mm 70.000 mm",
        f"off its path {tip[0]:.3f} mm {tip[1]:.3f} mm {tip[2]:.3f} mm",
        f"swing_joint {milli['swing']:.3f} mrad 200.000 mrad 300.000 mrad 1000.000 mrad 60 %",
        f"slide_joint {milli['slide']:.3f} mm 10.000 mm 20.000 mm 40.000 mm 150 %",
        "",
        "effort peak limit share jump",
        "left_wheel_joint 30 40 75 % 0 %",
        "right_wheel_joint 50 - - -",
        "steer_joint 3 15 20 % 0 %",
        "swing_joint 25 20 125 % 0 %",
        "slide_joint 60 80 75 % 0 %",
        "",
        "limit swing_joint effort: 25, limit 20, from 0.2 s for 0.17 s",
        "limit slide_joint velocity: 0.75, limit 0.5, from 0.4 s for 0.083 s",
        "limit left_wheel_joint effort limit bound from 0.2 s, at (0.10, 0.02) m, 0.25 s in all",
        "limit slide_joint upper position limit bound from 0.1 s, at (0.00, 0.02) m, 0.17 s in all",
        "ground keeps 0.12 m from tipping and uses 40 % of the grip at friction 0.7",
        "the actuators did 4 J of work; damping, friction and stops dissipated 3 J",
        "simulated 2.0 times faster than real time",
        "note a note",
        "report out/report.html, 1.2 MB (rpctl view out)",
    ]


def test_a_robot_and_its_limits(tricycle: Robot, printed: Printed) -> None:
    inspect.show_robot(tricycle)
    text = printed()
    for line in (
        "drive tricycle",
        "track 0.6 m; P, the middle of the axle, at (-0.1, 0) m",
        "root link forward at 0°, 0.05 m above the ground",
        "mass 27 kg",
        "dof 4 quasi-velocities",
        "v: forward speed of P, m/s",
        "steer_joint: steering rate, rad/s",
        "and the rates of swing_joint, slide_joint",
        "end effector slide",
        "wheel radius known from held by driven velocity effort",
        "swivel role driven at x, y trail because",
        "steer_joint steered yes 0.7, 0 m - contact below its axis, limits",
        "joint type lower home upper velocity effort",
        "swing_joint revolute -1 rad 0 rad 1.5 rad 2 rad/s 20 N·m",
        "slide_joint prismatic -0.1 m 0.05 m 0.4 m 0.5 m/s 80 N",
    ):
        assert line in text
    (left,) = (line for line in text if line.startswith("left_wheel_joint 0.1 m"))
    assert left.endswith("root yes 5 rad/s 40 N·m")
    (front,) = (line for line in text if line.startswith("front_wheel_joint 0.1 m"))
    assert front.endswith("steer_joint no - -")


def test_a_certificate_tells_its_worst(printed: Printed) -> None:
    near = Check("bias", "Lagrange", 4e-13, 1e-12, sample=3, entry="v")
    exact, bad = Check("inertia", "Lagrange", 0.0, 1e-12), Check("rolling", "A", 2e-3, 1e-6)
    scope = Scope("the equations", ("it stands, 0.1 m from tipping at home",), (), 0.1)
    good = Certificate(robot="golden", samples=5, seed=2, checks=(exact, near), scope=scope)
    verify.show_certificate(good)
    text = printed()
    assert "✓ bias Lagrange 4.0e-13 1e-12 v at sample 3" in text
    assert "✓ inertia Lagrange 0.0e+00 1e-12" in text
    assert "scope the equations; assumptions: it stands, 0.1 m from tipping at home" in text
    assert text[-1].startswith("✓ verified: 2 checks over 5 random states, seed 2")
    assert text[-1].endswith("nearest to its limit: bias, 4e-13 of 1e-12")
    verify.show_certificate(replace(good, checks=(exact, bad)))
    assert printed()[-1].startswith(
        "✗ not verified: rolling against A; 2 checks over 5 random states"
    )


def test_a_caster_trails_behind(tmp_path: Path, printed: Printed) -> None:
    """The log of a swivel has its contact ahead; people are told how far it lies behind."""
    robot = rpctl.load(write(tmp_path, vehicle("casters")))
    trails = {s.joint: s.trail for s in robot.drive.swivels}
    assert trails["caster_2"] == pytest.approx(-0.07, abs=5e-3)
    inspect.show_robot(robot)
    (row,) = (line for line in printed() if line.startswith("caster_2 caster"))
    assert "-0.3, 0 m 70" in row


def test_facts_are_in_si_units(tricycle: Robot) -> None:
    drive = replace(tricycle.drive, heading=0.25 * math.pi)
    known = facts(replace(tricycle, drive=drive))
    assert known["mass"] == pytest.approx(27.0)
    printed = known["drive"]
    assert printed["heading_deg"] == pytest.approx(45.0)
    assert printed["track"] == pytest.approx(0.6)
    assert printed["point"] == pytest.approx((-0.1, 0.0))
    assert printed["ground"] == pytest.approx(-0.05)
    wheels = {wheel["joint"]: wheel for wheel in printed["wheels"]}
    assert wheels["left_wheel_joint"]["radius"] == pytest.approx(0.1)
    limits = [(wheels[f"{w}_wheel_joint"]["effort"], wheels[f"{w}_wheel_joint"]["velocity"])
              for w in ("left", "right")]  # fmt: skip
    assert limits == [(40.0, 5.0), (math.inf, math.inf)]
    (swivel,) = printed["swivels"]
    assert swivel["pivot"] == pytest.approx((0.7, 0.0))
    swing, slide = known["joints"]
    keys = ("name", "type", "lower", "home", "upper", "velocity", "effort")
    assert [swing[key] for key in keys] == ["swing_joint", "revolute", -1.0, 0.0, 1.5, 2.0, 20.0]
    assert [slide[key] for key in keys[:3]] == ["slide_joint", "prismatic", -0.1]
    assert slide["home"] == pytest.approx(0.05)  # 0.3 of its range from its lower limit
    assert [slide[key] for key in keys[4:]] == [0.4, 0.5, 80.0]
    lines = TRICYCLE.splitlines()
    for told_of in (swing, slide, swivel, wheels["left_wheel_joint"]):
        name = told_of.get("name") or told_of["joint"]
        assert f'<joint name="{name}"' in lines[told_of["line"] - 1]
    assert known["meanings"] == {
        "v": "forward speed of P, m/s",
        "steer_joint": "steering rate, rad/s",
        "swing_joint": "rate, rad/s",
        "slide_joint": "rate, m/s",
    }


def test_figures_of_a_benchmark(golden: Run) -> None:
    """Shares of limits: the actuator without a limit does not count."""
    found = figures_of(golden, [1e-5, 3e-5] * 50)
    tau, limits = np.array(golden.tau)[:, [0, 2, 3, 4]], np.array([40.0, 15.0, 20.0, 80.0])
    expected: dict[str, Any] = {
        "rms_base": pytest.approx(math.sqrt((25 + 0.25 + 0.25 + 0.0169 + 0.01 + 0.0025) / 6)),
        "final_base": pytest.approx(0.05),
        "final_lateral": pytest.approx(0.04),
        "rms_end_effector": pytest.approx(math.sqrt((0.49 + 0.09 + 2 * 0.0049 + 2 * 0.0009) / 6)),
        "final_end_effector": pytest.approx(0.03),
        "peak_effort": pytest.approx(0.8),
        "rms_effort": pytest.approx(math.sqrt(float(np.mean((tau / limits) ** 2)))),
        "violations": (),
        "sample_time": pytest.approx(4e-5),
        "sample_time_99": pytest.approx(4e-5),
        "outcome": "late",
    }
    assert {name: getattr(found, name) for name in COLUMNS} == expected
    lifted = np.array(golden.log.joints)
    lifted[2, 1] = 0.5
    assert figures_of(vary(golden, joints=lifted)).violations == ("slide_joint upper",)


def row(
    law: LawPair, base: float, tip: float | None, *broken: str, outcome: str = "tracked"
) -> CompareRow:
    """Return a row, errors in m: the final ones are half of the others."""
    figures = Figures(
        outcome, rms_base=base, final_base=0.5 * base, final_lateral=0.25 * base,
        rms_end_effector=tip, final_end_effector=None if tip is None else 0.5 * tip,
        peak_effort=0.75, rms_effort=0.125, violations=broken, sample_time=4e-5,
        sample_time_99=9e-5,
    )  # fmt: skip
    return Row(CompareCell("nominal", law, RunSettings("line")), figures)


def test_table_of_a_benchmark(printed: Printed, tmp_path: Path) -> None:
    cell = CompareCell("nominal", LawPair("mpc", "paper"), RunSettings("line"))
    failed = Row(cell, Figures("refused", "it turns on the spot"))
    rows = [
        row(PAPER, 0.004, 0.006),
        row(PROPOSED, 0.003, 0.008),
        row(KANAYAMA, 0.001, None, "a upper", outcome="late"),
        row(LawPair("unified", "paper"), 0.002, 0.002, outcome="stuck"),
    ]
    compare.show_comparison([*rows, failed], PROPOSED, tmp_path)
    text = printed()
    for line in (
        "line paper+paper 4.00 2.00 6.00 3.00 75 % 12 % 0 40 90",
        f"{PROPOSED} 3.00 1.50 8.00 4.00 75 % 12 % 0 40 90",
        "kanayama+paper 1.00 0.50 - - 75 % 12 % 1 40 90",
        "mpc+paper - - - - - - - - -",
        "kanayama+paper, line: late; broke a upper",
        "unified+paper 2.00 1.00 2.00 1.00 75 % 12 % 0 40 90",
        "unified+paper, line: stuck",
        "mpc+paper, line: did not run: it turns on the spot",
        "nominal line end effector 8.00 6.00 6.00 paper+paper",
    ):
        assert line in text
    assert any("base rms final e.e. rms final peak rms limits sample 99 %" in line for line in text)
    assert any("mm mm mm mm effort effort broken µs µs" in line for line in text)
    said = " ".join(text)
    assert (
        "in 1 of 2 comparisons; where paper+paper works, it is at least as good in 1 of 2" in said
    )
