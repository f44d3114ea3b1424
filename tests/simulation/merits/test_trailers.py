"""What becomes of trailers: pulled they follow, pushed they are refused, folded they are told."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

import rpctl
from rpctl.control.controller import Controller
from rpctl.robot.model import Robot
from rpctl.simulation.merits.summary import summarize
from tests.robots import write
from tests.vehicles import CASTERS, caster, rear_axle, start, trailer

COARSE: dict[str, Any] = {  # s; so few samples are done sooner than their loop is built
    "control_period": 0.02,
    "plant_step": 0.02,
    "backend": "pinocchio",
    "collisions": False,
}


@pytest.fixture(scope="module")
def tug(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A differential base on a caster that pulls a trailer."""
    parts = start()
    rear_axle(parts)
    caster(parts, "caster", *CASTERS[0], twin=False)
    trailer(parts, "cart", "base", "-0.4 0.03 0.2", 0.7, "0 0 -1")
    path = tmp_path_factory.mktemp("tug") / "tug.urdf"
    path.write_text(parts.text("tug"))
    return rpctl.load(path)


def test_a_trailer_that_is_pulled_follows(tug: Robot) -> None:
    """On a circle it settles where its axle, too, heads about the centre."""
    run = rpctl.track(tug, "circle", duration=20.0, **COARSE)
    assert summarize(run).outcome == "tracked"
    radius, hitch, length = abs(run.nu[-1, 0] / run.nu[-1, 1]), 0.4, 0.7
    swung = tug.joint_position(run.q[-1], "cart_hitch")
    # The hitch lies on a wider circle than P, the trailer's axle a tangent's length off it.
    assert swung == pytest.approx(_settled(radius, hitch, length), abs=0.03)


def _settled(radius: float, hitch: float, length: float) -> float:
    return math.atan(hitch / radius) + math.asin(length / math.hypot(radius, hitch))


def test_a_trailer_that_folds_is_told(tug: Robot) -> None:
    """Turning on the spot folds it: outcome, and exit code 1."""
    run = rpctl.track(tug, "spin", duration=12.0, **COARSE)
    assert summarize(run).outcome == "jack-knifed"
    assert "cart_hitch leaves -80.2° to 80.2°" in summarize(run).outcome_sentence


@pytest.mark.parametrize(("at", "count"), [("track", 2), ("controller", 1)])
def test_a_trailer_is_not_pushed(tmp_path: Path, at: str, count: int) -> None:
    """No law holds its hitch: refused before the start, with the way out."""
    parts, places = start(), [("base", "-0.4 0.03 0.2"), *2 * [("{}_body", "-0.8 0 0")]]
    rear_axle(parts)
    caster(parts, "caster", *CASTERS[0], twin=False)
    names = ["cart", "second", "third"][:count]
    for before, name, (puller, place) in zip(["", *names], names, places, strict=False):
        trailer(parts, name, puller.format(before), place, 0.7, "0 0 -1")
    tug = rpctl.load(write(tmp_path, parts.text("tug")))
    assert len(tug.drive.trailers) == count
    reference = rpctl.load_reference(tug, "reverse")
    with pytest.raises(rpctl.RpctlError, match=r"pushes the trailer .* --lock cart_hitch"):
        if at == "track":
            rpctl.track(tug, reference, duration=5.0)
        else:
            Controller(tug, reference)
