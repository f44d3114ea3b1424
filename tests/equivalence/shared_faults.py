"""Faults of what the engines read and of the drive's record, which once all derivations shared.

``python -m tests.equivalence.shared_faults`` prints which rows of the certificate catch which.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import rpctl
from rpctl import Robot
from rpctl.description.frozen_tree import FrozenTree
from rpctl.drive.drive import Drive, Swivel, Wheel
from rpctl.equivalence.certificate import Check
from rpctl.robot.build import build

SAMPLES = 1


@dataclass(frozen=True)
class Fault:
    """A fault: the robot of the catalogue that has it, and what it does to it."""

    victim: str
    inject: Callable[[Robot], Robot]


def wheels(change: Callable[[Wheel], dict[str, Any]], count: int = 99) -> Callable[[Robot], Robot]:
    """Return the change of the records of a robot's first ``count`` wheels."""

    def inject(robot: Robot) -> Robot:
        first = [
            dataclasses.replace(w, **change(w)) if k < count else w
            for k, w in enumerate(robot.drive.wheels)
        ]
        return dataclasses.replace(
            robot, drive=dataclasses.replace(robot.drive, wheels=tuple(first))
        )

    return inject


def swivels(change: Callable[[Swivel], dict[str, Any]]) -> Callable[[Robot], Robot]:
    """Return the change of the record of a robot's first swivel."""

    def inject(robot: Robot) -> Robot:
        first, *rest = robot.drive.swivels
        first = dataclasses.replace(first, **change(first))
        return dataclasses.replace(
            robot, drive=dataclasses.replace(robot.drive, swivels=(first, *rest))
        )

    return inject


def drive(change: Callable[[Drive], dict[str, Any]]) -> Callable[[Robot], Robot]:
    """Return the change of a robot's drive."""

    def inject(robot: Robot) -> Robot:
        return dataclasses.replace(
            robot, drive=dataclasses.replace(robot.drive, **change(robot.drive))
        )

    return inject


def rewritten(pattern: str, new: str | Callable[[re.Match[str]], str]) -> Callable[[Robot], Robot]:
    """Return the change of the XML that Pinocchio reads: of every match of a pattern."""

    def inject(robot: Robot) -> Robot:
        xml, count = re.subn(pattern, new, robot.description.xml)
        assert count, pattern
        description = dataclasses.replace(robot.description, xml=xml)
        model = build(FrozenTree(description, robot.locked))
        return dataclasses.replace(robot, description=description, model=model)

    return inject


def _turned(wheel: Wheel, degrees: float) -> dict[str, Any]:
    """Return a wheel's direction turned."""
    angle = math.atan2(wheel.direction[1], wheel.direction[0]) + math.radians(degrees)
    return {"direction": (math.cos(angle), math.sin(angle))}


def _flatter(wheel: Wheel) -> dict[str, Any]:
    """Return a mecanum wheel's direction with its roller at 30° instead of 45°."""
    return _turned(wheel, -15.0 if wheel.direction[1] > 0.0 else 15.0)


def _negated(match: re.Match[str]) -> str:
    return f'axis xyz="{" ".join(str(-float(word)) for word in match[1].split())}"'


def _doubled(match: re.Match[str]) -> str:
    return f'mass value="{2.0 * float(match[1])!r}"'


FAULTS = {
    "radius taken for diameter": Fault("paper", wheels(lambda w: {"radius": 2.0 * w.radius})),
    "one wheel 10 % larger": Fault("paper", wheels(lambda w: {"radius": 1.1 * w.radius}, 1)),
    "a wheel 5 cm off": Fault("paper", wheels(lambda w: {"offset": w.offset + 0.05}, 1)),
    "P 20 cm to the side": Fault("paper", drive(lambda d: {"point": (d.point[0], 0.2)})),
    "P 20 cm ahead": Fault("paper", drive(lambda d: {"point": (d.point[0] + 0.2, d.point[1])})),
    "a pivot 10 cm off": Fault("car", swivels(lambda s: {"pivot": (s.pivot[0] + 0.1, s.pivot[1])})),
    "a steering sign": Fault("tricycle", swivels(lambda s: {"sign": -s.sign})),
    "a doubled trail": Fault("casters", swivels(lambda s: {"trail": 2.0 * s.trail})),
    "a reversed caster": Fault("casters", swivels(lambda s: {"heading": s.heading + math.pi})),
    "a powered caster's trail 3 % long": Fault(
        "caster_drive", swivels(lambda s: {"trail": 1.03 * s.trail})
    ),
    "a powered wheel 5 mm beside its axis": Fault(
        "caster_drive", wheels(lambda w: {"lateral": w.lateral + 0.005}, 1)
    ),
    "rollers at 30°": Fault("mecanum", wheels(_flatter)),
    "omni directions turned by 20°": Fault("omni", wheels(lambda w: _turned(w, 20.0))),
    "inertial origins dropped": Fault(
        "mixed_chain", rewritten(r"(<inertial>\s*)<origin[^>]*/>", r"\1")
    ),
    "a joint axis negated": Fault(
        "mixed_chain", rewritten(r'axis xyz="(0.36 0.48 0.8)"', _negated)
    ),
    "masses doubled": Fault("mixed_chain", rewritten(r'mass value="([^"]*)"', _doubled)),
}


def caught(fault: Fault, robot: Robot) -> tuple[Check, ...]:
    """Return the rows that fail for a robot with the fault."""
    proof = rpctl.verify(fault.inject(robot), samples=SAMPLES)
    return tuple(check for check in proof.checks if not check.passed)


def main() -> None:
    """Print each fault, how many rows catch it, and which."""
    for name, fault in FAULTS.items():
        found = caught(fault, rpctl.load(fault.victim))
        rows: dict[str, list[str]] = {}
        for check in found:
            rows.setdefault(check.against, []).append(check.name)
        listed = "; ".join(f"{who}: {', '.join(names)}" for who, names in rows.items())
        print(f"{name:30s} {fault.victim:12s} {len(found):2d}  {listed}", flush=True)


if __name__ == "__main__":
    main()
