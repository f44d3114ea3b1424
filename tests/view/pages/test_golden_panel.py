"""The texts beside a scene: each figure with its unit."""

from __future__ import annotations

import re
from dataclasses import replace
from html import unescape
from typing import Any

import numpy as np

import rpctl
from rpctl import Run, summarize
from rpctl.control.registry import Unregistered
from rpctl.robot.variation import CarriedLoad
from rpctl.simulation.config import Config, RunSettings
from rpctl.simulation.plants.plant import Plant
from rpctl.simulation.plants.settings import Noise, SensorBias, Wrench
from rpctl.view.pages.page import Badge, LegendEntry
from rpctl.view.pages.panel import (
    compare_legend,
    compare_panel,
    headline_badges,
    headline_rows,
    legend,
    merits,
    panel,
)
from rpctl.view.pages.settings import setting_texts
from tests.golden import COUNT, beside_its_path
from tests.runs import vary
from tests.view.readers import panel_text
from tests.view.samples import DISC, PILLAR, with_obstacles

CHECK = {"name": "M", "against": "G", "residual": 3e-14, "limit": 1e-12, "passed": True}
CERTIFICATE: dict[str, Any] = {
    "passed": True, "samples": 7, "seed": 3, "checks": [CHECK],
    "skipped": [{"name": "h", "against": "MuJoCo", "note": "not installed"}],
}  # fmt: skip


def rows(page: str) -> dict[str, str]:
    """Return what a page says of each of its labels."""
    pairs = re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", page)
    return {unescape(label): unescape(value) for label, value in pairs}


def badges(page: str) -> list[tuple[str, str]]:
    return re.findall(r'<span class="badge (good|bad)">(.*?)</span>', page)


def entries(shown: list[LegendEntry]) -> list[tuple[str, bool, str]]:
    """Return layer, whether it is shown, and name of the entries of a legend."""
    return [(each.layer, each.shown, each.text) for each in shown]


def compared(runs: list[Run]) -> str:
    """Return the panel of several runs."""
    names = [f"run {k}" for k in range(len(runs))]
    return panel_text(compare_panel(runs, names, [summarize(run) for run in runs], ()))


def test_the_gains_are_told_once(golden: Run) -> None:
    notes = ["gains: 2.5 Hz, as delay allows", "a caster sinks"]
    page = panel_text(panel(golden, summarize(golden), notes))
    assert "Notes (1)" in page and "a caster sinks" in page
    assert "<li>gains: 2.5 Hz" not in page
    assert "Notes" not in panel_text(panel(golden, summarize(golden), notes[:1]))


def test_a_figure_below_a_micrometre_is_told_as_that(golden: Run) -> None:
    for error, text in ((9e-7, "< 1 µm"), (1.1e-6, "1.1 µm"), (0.0, "0 m")):
        known = merits(golden, replace(summarize(golden), final_base_error=error))
        assert known["final_base_error"] == text


def test_panel_of_a_run(golden: Run) -> None:
    kinematic = {"horizon": 0.3, "steps": 20, "strict": True, "gain": None, "weights": {"law": 2.0}}
    inner = {"inner": Unregistered("BoundedDynamic"), "horizon": 0.5}
    config = Config(
        Unregistered("Horizon", kinematic),
        Unregistered("IntegralDynamic", inner),
        RunSettings("/home/somebody/eight.csv", initial_error=(0.1, -0.2, 0.3)),
    )
    run = vary(golden, certificate=CERTIFICATE, config=config, locked={"a": 1.0})
    run = beside_its_path(run)
    page = panel_text(panel(run, summarize(run), ["a note"]))
    setting_rows = rows(page)
    expected = {
        "Base, rms": "2.06 m",
        "Base, final": "50 mm",
        "Base, final lateral": "40 mm",
        "Base off its path, rms": "20 mm",
        "Base behind, at most": "0.10 s (100 mm)",
        "End effector, rms": "314 mm",
        "End effector, final": "30 mm",
        "Largest effort / limit": "80 %",
        "Simulated at": "2 × real time",
        "M · G": "3.0e-14 ≤ 1e-12",
        "h": "MuJoCo: not installed",
        "Reference": "eight.csv",
        "Kinematic law": "Horizon",
        "Horizon h, s": "0.3",
        "Steps N": "20",
        "Strict": "yes",
        "Dynamic law": "IntegralDynamic",
        "Law within": "BoundedDynamic",
        "Horizon h, s (dynamic)": "0.5",
        "Control period, s": "0.002",
        "Initial error, m, m, rad": "0.1, -0.2, 0.3",
        "Drive": "tricycle",
        "Wheels": "3, radius 0.1 m",
        "Quasi-velocities": "4",
        "Actuators": "5",
        "Frozen joints": "1",
        "End effector": "slide",
    }
    assert {label: setting_rows.get(label) for label in expected} == expected
    assert not {"Gain k, 1/s", "Weights"} & set(setting_rows)
    assert badges(page) == [("good", "late"), ("good", "within limits"), ("good", "verified")]
    assert (
        "<li>Late: the run is too short to judge: base is up to 102 mm from its reference" in page
    )
    assert "<li>Ideal plant: the simulated robot equals the" in page
    assert "Worst of 7 random states, seed 3." in page
    assert "On the ground: keeps 0.12 m from tipping" in page
    bound = "slide_joint upper position limit bound from 0.1 s, at (0.00, 0.02) m, 0.17 s in all."
    assert bound in page
    assert "Notes (1)" in page


def test_headline_of_a_run(golden: Run) -> None:
    run = beside_its_path(replace(golden, certificate=CERTIFICATE))
    assert dict(headline_rows(run, summarize(run))) == {
        "Base, rms": "2.06 m", "Base off its path, rms": "20 mm", "End effector, rms": "314 mm",
        "Effort / limit": "80 %",
    }  # fmt: skip
    fine = [Badge(True, text) for text in ("late", "dynamics verified", "within limits")]
    assert headline_badges(run, summarize(run)) == fine
    tau = np.array(golden.tau)
    tau[2, 0] = -50.0
    broken = vary(golden, tau=tau, certificate={**CERTIFICATE, "passed": False})
    assert dict(headline_rows(broken, summarize(broken)))["Effort / limit"] == "125 %"
    not_fine = [Badge(False, "not verified"), Badge(False, "limits broken")]
    assert headline_badges(broken, summarize(broken)) == [fine[0], *not_fine]
    lost = summarize(vary(golden, base=np.full((COUNT, 3), np.nan)))
    assert headline_badges(broken, lost)[0] == Badge(False, "diverging")


def test_legend_names_what_is_drawn(golden: Run) -> None:
    assert entries(legend(golden)) == [
        ("base", True, "Base"),
        ("tip", True, "End effector"),
        ("desired", True, "Desired"),
        ("ghost", True, "Reference robot"),
        ("effort", False, "Effort as colour"),
        ("loads", True, "Ground reactions"),
        ("zmp", True, "Support, zero-moment point"),
    ]
    none = np.empty((COUNT, 0))
    bare = vary(golden, tip_margin=none, ee=none, effort_limits=(np.inf,) * 5)
    assert [layer for layer, *_ in entries(legend(bare))] == [
        "base",
        "desired",
        "ghost",
        "effort",
    ]
    unloaded = entries(legend(vary(golden, contact_load=none)))
    assert [layer for layer, *_ in unloaded][-2:] == ["effort", "zmp"]
    assert entries(legend(with_obstacles(golden, DISC, tip=(PILLAR,))))[-2:] == [
        ("obstacles-base", True, "Base obstacles"),
        ("obstacles-tip", True, "End-effector obstacles"),
    ]


def test_comparison_tells_each_run_in_its_column(golden: Run) -> None:
    tau, none = 2.0 * np.array(golden.tau), np.empty((COUNT, 0))
    half = vary(golden, e=0.1 * golden.log.e, tau=tau, certificate=CERTIFICATE)
    bare = vary(half, end_effector=None, ee=none, ee_ref=none, effort_limits=(np.inf,) * 5)
    runs = [golden, half, bare]
    page = panel_text(
        compare_panel(runs, ["one", "two", "three"], [summarize(run) for run in runs], ())
    )
    table = {
        unescape(label): [unescape(cell) for cell in re.findall(r"<td>(.*?)</td>", cells)]
        for label, cells in re.findall(r'<tr><th scope="row">(.*?)</th>(.*?)</tr>', page)
    }
    assert table["Base, rms"] == ["2.06 m", "206 mm", "206 mm"]
    assert table["Base, final lateral"] == ["40 mm", "4 mm", "4 mm"]
    assert table["End effector, final"] == ["30 mm", "30 mm", "–"]
    assert table["Largest effort / limit"] == ["80 %", "160 %", "–"]
    assert [badges(cell)[0][0] for cell in table["Limits"]] == ["good", "bad", "good"]
    assert table["Dynamics"][0] == "–"
    assert entries(compare_legend(runs, ["one", "two", "three"])) == [
        ("run-1", True, "one (solid)"),
        ("run-2", True, "two"),
        ("run-3", True, "three"),
        ("desired", True, "Desired"),
        ("ghost", False, "Reference robot"),
    ]


def test_settings_that_differ_come_first(golden: Run) -> None:
    others = {**vars(rpctl.UnifiedKinematic()), "period": 0.5}
    other = replace(golden, config=Config(Unregistered("UnifiedKinematic", others)))
    page = panel_text(
        compare_panel([golden, other], ["a", "b"], [summarize(golden), summarize(other)], ())
    )
    settings = page.partition("<h2>Settings</h2>")[2]
    labels = re.findall(r'<th scope="row">(.*?)</th>', settings)
    assert labels[0] == "Time from solve to solve, s"
    assert "<td><b>–</b></td><td><b>0.5</b></td>" in settings
    assert "<td>eight</td><td>eight</td>" in settings


def test_what_the_plant_varies_is_told_with_units(golden: Run) -> None:
    plant = Plant(
        masses={"fore*": 1.1}, centres={"fore*": (0.01, 0.0, -0.02)}, track=1.02,
        noise=Noise(position=0.002), payload=CarriedLoad(mass=1.5), effort=0.5,
        backlash={"turns": 0.02}, slope=(0.1, -0.2), sensor_bias=SensorBias(heading=-0.01),
        wrenches=(Wrench("fore", (1.0, 0.0, -2.0), start=0.5), Wrench("aft", end=2.0)),
    )  # fmt: skip
    plain = setting_texts(replace(golden, config=Config()))
    told = setting_texts(replace(golden, config=Config(plant=plant)))
    assert {label: told[label] for label in told.keys() - plain.keys()} == {
        "Scale of the mass of fore*": "1.1",
        "Offset of the centre of mass of fore*, m": "0.01, 0, -0.02",
        "Scale of the track": "1.02",
        "Noise: position, x and y, m": "0.002",
        "Payload: mass, kg": "1.5",
        "Scale of the effort limits": "0.5",
        "Backlash of turns, rad or m": "0.02",
        "Slope, rad": "0.1, -0.2",
        "Constant error: heading, rad": "-0.01",
        "Push 1: Link": "fore",
        "Push 1: Force, N": "1, 0, -2",
        "Push 1: Start, s": "0.5",
        "Push 2: Link": "aft",
        "Push 2: End, s": "2",
    }
