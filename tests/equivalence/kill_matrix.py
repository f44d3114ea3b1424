"""The kill matrix: which planted faults trip which rows of the certificate.

Two kinds of faults are planted. Those of a robot and its dynamics (``FAULTS``), on differential,
steered, following, trailing and roller wheels, each trip two rows or more. Those of one derivation
alone (``PROBES``) trip its row, and few others: a row that is hollow, compared with itself, or a
million times too wide, trips on none.

``python -m tests.equivalence.kill_matrix`` prints the matrix.
"""

from __future__ import annotations

import dataclasses
import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pinocchio as pin

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.dynamics import rolling
from rpctl.equivalence import checks, wheel_slip
from rpctl.equivalence.certificate import Check
from rpctl.equivalence.gibbs_appell import GibbsAppell
from rpctl.equivalence.mujoco_engine import MujocoEngine
from rpctl.equivalence.rolling_rows import FileRows
from rpctl.equivalence.wheel_slip import FileMotion, Slip
from tests.equivalence import mutations, shared_faults
from tests.equivalence.fault_injection import Injection, in_function, in_method, rolling_of
from tests.proofs import failed
from tests.random_robots import generate
from tests.robots import write

LOSSES = '<dynamics damping="0.{0}" friction="0.0{0}"/></joint>'
CheckKey = tuple[str, str]  # a check's name, and against what
SEED = 59  # of a robot with slanted frames, wheels beside their joints, a mimic, R and P joints
SAMPLES = 1
GENERAL = "general"  # a differential drive of general numbers with five arm joints
LOSSY = "lossy"  # the same, each joint with a damping and a friction of its own
MAX_ROWS_TRIPPED = 4  # rows that a probe trips at most
SMALL = 1e-6  # relative: a million times the limit of a comparison to rounding
VISIBLE = 1e-4  # relative, m/s or 1/s: a hundred times the limit of one by differences
TINY = 1e-11  # relative: ten times the limit of a comparison to rounding


def victim(name: str) -> Robot:
    """Return a robot of the catalogue, or the one of general numbers."""
    if name not in (GENERAL, LOSSY):
        return rpctl.load(name)
    with tempfile.TemporaryDirectory() as folder:
        text = generate(np.random.default_rng(SEED), 5).text
        if name == LOSSY:
            sizes = count(1)
            text = re.sub("</joint>", lambda _: LOSSES.format(next(sizes)), text)
        return rpctl.load(write(Path(folder), text))


def tripped(robot: Robot, inject: Injection) -> tuple[Check, ...]:
    """Return the rows that fail with a fault planted."""
    with inject(robot) as mutant:
        proof = rpctl.verify(mutant, samples=SAMPLES)
    return tuple(failed(proof))


def of_robot(change: Callable[[Robot], Robot]) -> Injection:
    """Return the plant of a fault that makes another robot."""

    @contextmanager
    def inject(robot: Robot) -> Iterator[Robot]:
        yield change(robot)

    return inject


def in_class(owner: type, name: str, change: Callable[..., Any]) -> Injection:
    """Plant ``change(result, *arguments)`` in place of what a method returns."""

    @contextmanager
    def inject(robot: Robot) -> Iterator[Robot]:
        original = getattr(owner, name)
        setattr(owner, name, lambda *arguments: change(original(*arguments), *arguments))
        try:
            yield robot
        finally:
            setattr(owner, name, original)

    return inject


def in_module(module: ModuleType, name: str, change: Callable[..., Any]) -> Injection:
    """Plant ``change(result)`` in place of what a function returns, in one module alone."""

    @contextmanager
    def inject(robot: Robot) -> Iterator[Robot]:
        original = getattr(module, name)
        setattr(module, name, lambda *arguments: change(original(*arguments)))
        try:
            yield robot
        finally:
            setattr(module, name, original)

    return inject


def scaled(factor: float) -> Callable[..., Any]:
    """Return the change of a result by a factor."""
    return lambda result, *arguments: result * factor


def result_of(function: Callable[..., Any], change: Callable[..., Any]) -> Injection:
    """Plant ``change(result)`` in place of what a function returns."""
    return in_function(function, lambda original, *arguments: change(original(*arguments)))


def field(name: str, factor: float = 1.0 + SMALL) -> Callable[..., Any]:
    """Return the change of one field of a record by a factor."""

    def changed(record: Any, *arguments: object) -> Any:
        value = {name: factor * getattr(record, name)}
        return (
            record._replace(**value)
            if hasattr(record, "_replace")
            else (dataclasses.replace(record, **value))
        )

    return changed


def entry(name: str, index: tuple[Any, ...], factor: float) -> Callable[..., Any]:
    """Return the change of one entry of an array of a record."""

    def changed(record: Any, *arguments: object) -> Any:
        array = getattr(record, name).copy()
        array[index] *= factor
        return dataclasses.replace(record, **{name: array})

    return changed


def pivots(change: Callable[[float, float], tuple[float, float]]) -> Callable[[Robot], Robot]:
    """Return the change of the places of a robot's swivels."""

    def changed(robot: Robot) -> Robot:
        parts = (dataclasses.replace(s, pivot=change(*s.pivot)) for s in robot.drive.swivels)
        drive = dataclasses.replace(robot.drive, swivels=tuple(parts))
        return dataclasses.replace(robot, drive=drive)

    return changed


def trails(robot: Robot) -> Robot:
    """Return a robot whose swivels trail by a little more."""
    parts = (dataclasses.replace(s, trail=s.trail - SMALL) for s in robot.drive.swivels)
    drive = dataclasses.replace(robot.drive, swivels=tuple(parts))
    return dataclasses.replace(robot, drive=drive)


def directions(robot: Robot) -> Robot:
    """Return a robot whose rollers are turned by a little."""
    turned = (
        dataclasses.replace(w, direction=(w.direction[0] - SMALL * w.direction[1],
                                          w.direction[1] + SMALL * w.direction[0]))
        for w in robot.drive.wheels
    )  # fmt: skip
    drive = dataclasses.replace(robot.drive, wheels=tuple(turned))
    return dataclasses.replace(robot, drive=drive)


def lost(drift: Array, *arguments: Any) -> Array:
    return np.zeros_like(drift)


def pushed(found: tuple[Array, Array], *arguments: object) -> tuple[Array, Array]:
    """Return rows of rolling whose Ȧ v is a little off."""
    A, drift = found
    return A, drift + SMALL * np.arange(1.0, len(drift) + 1.0)


def braking(change: Callable[[Array], Array]) -> Injection:
    """Plant another damping of the joints than that of the file, nv numbers."""

    def changed(robot: Robot) -> Robot:
        assert robot.losses is not None
        damping = np.array([*np.zeros(3), *change(robot.losses.damping[3:])])
        return dataclasses.replace(robot, losses=dataclasses.replace(robot.losses, damping=damping))

    return of_robot(changed)


def negative(robot: Robot) -> Robot:
    """Return a robot whose file itself gives its last arm link moments of inertia below zero."""
    name, description = robot.joints[-1].child.encode(), robot.description

    def worse(data: bytes) -> bytes:
        start = data.index(b'<link name="' + name)
        end = data.index(b"</link>", start)
        body = re.sub(rb'(ixx|iyy|izz)="[^"]*"', rb'\1="-50"', data[start:end])
        assert body != data[start:end]
        return data[:start] + body + data[end:]

    raw, xml = worse(description.raw), worse(description.xml.encode()).decode()
    description = dataclasses.replace(description, raw=raw, xml=xml)
    model = pin.buildModelFromXML(xml, pin.JointModelPlanar())  # rpctl.load refuses it
    return dataclasses.replace(robot, description=description, model=model)


FAULTS: dict[str, tuple[str, Injection]] = {
    **{name: (GENERAL, inject) for name, inject in mutations.MUTATIONS.items()},
    **{
        f"shared: {name}": (fault.victim, of_robot(fault.inject))
        for name, fault in shared_faults.FAULTS.items()
    },
    "steered A: pivots": ("car", rolling_of(pivots(lambda x, y: (x + SMALL, y - SMALL)))),
    "steered Ȧv: lost": ("tricycle", in_class(rolling.RollingConstraints, "drift", lost)),
    "following A: pivots": ("swerve", rolling_of(pivots(lambda x, y: (x * (1 + SMALL), y)))),
    "following Ȧv: lost": ("swerve", in_class(rolling.RollingConstraints, "drift", lost)),
    "caster A: trails": ("casters", rolling_of(trails)),
    "caster Ȧv: lost": ("casters", in_class(rolling.RollingConstraints, "drift", lost)),
    "powered caster A: trails": ("caster_drive", rolling_of(trails)),
    "powered caster Ȧv: lost": (
        "caster_drive",
        in_class(rolling.RollingConstraints, "drift", lost),
    ),
    "roller A: directions": ("mecanum", rolling_of(directions)),
    "omni A: directions": ("omni", rolling_of(directions)),
    "damping: left out": (LOSSY, braking(np.zeros_like)),
    "damping: wrong sign": (LOSSY, braking(np.negative)),
    "damping: of the next joint": (LOSSY, braking(lambda damping: np.roll(damping, 1))),
    "ℓ: left out": (LOSSY, in_class(ReducedDynamics, "losses", scaled(0.0))),
    "ℓ: wrong sign": (LOSSY, in_class(ReducedDynamics, "losses", scaled(-1.0))),
    "file: an inertia below zero": (GENERAL, of_robot(negative)),
}

OF_LOSSES = [name for name in FAULTS if name.startswith(("damping: ", "ℓ: "))]
OF_ROLLING = [name for name in FAULTS if "A: " in name or "Ȧv: " in name]  # the product's rows


def faster(found: Slip, *arguments: object) -> Slip:
    """Return a slip whose base speeds are a little off."""
    return dataclasses.replace(found, base={k: x + SMALL for k, x in found.base.items()})


def dragged(velocity: Array, motion: FileMotion, link: str, point: Array) -> Array:
    """Return a velocity as if the wheels' joints turned the other way by 3 %."""
    return velocity + 0.03 * np.array([1.0, 1.0, 0.0]) * (link != motion.raw.root)


def lower(robot: Robot) -> Robot:
    """Return a robot whose drive has the ground a little lower."""
    drive = dataclasses.replace(robot.drive, ground=robot.drive.ground - SMALL)
    return dataclasses.replace(robot, drive=drive)


def heavier(
    original: Callable[..., Array], dynamics: object, q: Array, nu: Array, a: Array
) -> Array:
    """Return M ν̇ + h with a little more of M ν̇."""
    bias = original(dynamics, q, nu, np.zeros_like(a))
    return bias + (1.0 + TINY) * (original(dynamics, q, nu, a) - bias)


PROBES: dict[str, tuple[str, Injection]] = {
    "record: ground": (GENERAL, of_robot(lower)),
    "slip: wheels 3 % fast": (GENERAL, in_class(FileMotion, "velocity", dragged)),
    "slip: base speeds": (GENERAL, result_of(wheel_slip.slip, faster)),
    "oracle, full: M": (GENERAL, in_class(GibbsAppell, "full", field("M"))),
    "oracle, full: h": (GENERAL, in_class(GibbsAppell, "full", field("h"))),
    "M: largest entries": (GENERAL, in_method("inertia", mutations.scaled(slice(None), 1 + TINY))),
    "oracle: M, a small entry": (
        GENERAL,
        in_class(GibbsAppell, "reduced", entry("M", (..., -1, -1), 1 + 1e-9)),
    ),
    "oracle: h": (GENERAL, in_class(GibbsAppell, "reduced", field("h"))),
    "oracle: B": (GENERAL, in_class(GibbsAppell, "reduced", field("B"))),
    "oracle: root": (GENERAL, in_class(GibbsAppell, "reduced", field("root"))),
    "oracle: G": (GENERAL, in_class(GibbsAppell, "gibbs", scaled(1.0 + SMALL))),
    "MuJoCo: M": (GENERAL, in_class(MujocoEngine, "reduced", field("M"))),
    "MuJoCo: h": (GENERAL, in_class(MujocoEngine, "reduced", field("h"))),
    "MuJoCo: B": (GENERAL, in_class(MujocoEngine, "reduced", field("B"))),
    "MuJoCo: damping left out": (LOSSY, in_class(MujocoEngine, "reduced", field("damping", 0.0))),
    "MuJoCo: damping": (LOSSY, in_class(MujocoEngine, "reduced", field("damping"))),
    "Lagrange: v̇": (GENERAL, result_of(checks.constrained_motion, field("v_dot"))),
    "Lagrange: Aᵀλ": (GENERAL, result_of(checks.constrained_motion, field("force"))),
    "Lagrange: Ȧv": (GENERAL, in_class(FileRows, "at", pushed)),
    "Pinocchio: v̇": (GENERAL, result_of(checks.pinocchio_motion, scaled(1.0 + SMALL))),
    "inverse: 1e-11 of M ν̇": (GENERAL, in_method("inverse", heavier)),
    "forward: 1e-6": (GENERAL, in_method("forward", mutations.scaled(slice(None)))),
    "energy: 1 %": (GENERAL, in_class(ReducedDynamics, "energy", scaled(1.01))),
    "differences: S": ("swerve", in_module(checks, "basis", scaled(1.0 + VISIBLE))),
    "Pinocchio: C": (GENERAL, in_module(pin, "computeCoriolisMatrix", scaled(1.0 + VISIBLE))),
}


def main() -> None:
    """Print each fault, how many rows it trips, and which; then the rows that nothing trips."""
    robots: dict[str, Robot] = {}
    rows: dict[CheckKey, int] = {}
    for name, (who, inject) in (*FAULTS.items(), *PROBES.items()):
        robot = robots.setdefault(who, victim(who))
        found = tripped(robot, inject)
        for check in found:
            key = check.name, check.against
            rows[key] = min(rows.get(key, 99), len(found))
        listed = "; ".join(f"{check.name} ({check.against})" for check in found)
        print(f"{name:36s} {who:10s} {len(found):2d}  {listed}", flush=True)
    for check in rpctl.verify(victim("swerve"), samples=1).checks:
        print(rows.get((check.name, check.against), "none"), check.name, check.against)


if __name__ == "__main__":
    main()
