"""Faults to plant in a robot or its dynamics: each changes one thing, mostly by little."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

from rpctl import Robot
from rpctl.arrays import Array
from rpctl.drive.drive import Wheel
from rpctl.dynamics import rolling
from rpctl.dynamics.projection import LevelProjection, Projection
from rpctl.dynamics.rolling import selection
from tests.equivalence.fault_injection import (
    Injection,
    in_body,
    in_function,
    in_method,
    in_model,
    in_placement,
    rolling_of,
    selection_of,
)

SMALL = 1e-6  # relative, m or rad: far above the limits of the certificate, far below the eye
SECOND_ORDER = 1e-5  # rad, where an angle enters by its cosine only


def wheels(change: Callable[[Wheel], Wheel], count: int = 2) -> Callable[[Robot], Robot]:
    """Return the change of a robot's first ``count`` wheels."""

    def changed(robot: Robot) -> Robot:
        drive = robot.drive
        new = tuple(change(w) if k < count else w for k, w in enumerate(drive.wheels))
        return dataclasses.replace(robot, drive=dataclasses.replace(drive, wheels=new))

    return changed


def larger(wheel: Wheel) -> Wheel:
    return dataclasses.replace(wheel, radius=wheel.radius * (1.0 + SMALL))


def shifted(wheel: Wheel) -> Wheel:
    return dataclasses.replace(wheel, offset=wheel.offset + SMALL)


def upside_down(wheel: Wheel) -> Wheel:
    return dataclasses.replace(wheel, radius=-wheel.radius)


def mimic(factor: float) -> Callable[[Robot], Robot]:
    """Return the change of a robot's mimic ratios."""

    def changed(robot: Robot) -> Robot:
        joints = []
        for joint in robot.description.joints:
            if joint.mimic is not None:
                ratio = dataclasses.replace(joint.mimic, multiplier=joint.mimic.multiplier * factor)
                joint = dataclasses.replace(joint, mimic=ratio)
            joints.append(joint)
        description = dataclasses.replace(robot.description, joints=tuple(joints))
        return dataclasses.replace(robot, description=description)

    return changed


def ahead(original: Callable[..., Any], *arguments: Any) -> Any:
    """Move the contact points a little off the wheels' lowest points."""
    up = rolling.UP
    rolling.UP = up + np.array([SMALL, SMALL, 0.0])
    try:
        return original(*arguments)
    finally:
        rolling.UP = up


def coriolis(factor: float) -> Callable[..., Array]:
    """Return the change of the velocity terms of h by a factor."""

    def changed(original: Callable[..., Array], dynamics: object, q: Array, nu: Array) -> Array:
        gravity = original(dynamics, q, np.zeros_like(nu))
        return gravity + factor * (original(dynamics, q, nu) - gravity)

    return changed


def scaled(index: Any, factor: float = 1.0 + SMALL) -> Callable[..., Array]:
    """Return the change of an entry of a result by a factor."""

    def changed(original: Callable[..., Array], *arguments: Any) -> Array:
        value = np.array(original(*arguments))
        value[index] *= factor
        return value

    return changed


def slipping(original: Callable[..., Projection], dynamics: object, q: Array) -> Projection:
    at = original(dynamics, q)
    S = at.S.copy()
    S[1, 1] += SMALL
    return dataclasses.replace(at, S=S)


def drifting(original: Callable[..., Array], at: Projection, nu: Array) -> Array:
    drift = original(at, nu).copy()
    drift[1] += nu[0] * nu[1]  # the base's classical acceleration, where v̇ in the body is meant
    return drift


def swapped(original: Callable[..., Array], *arguments: Any) -> Array:
    W = original(*arguments)
    W[[-1, -2]] = W[[-2, -1]]
    return W


def wheel_sign(original: Callable[..., None], dynamics: Any, robot: Robot) -> None:
    original(dynamics, robot)
    dynamics.columns[:, 1] *= -1.0


def without_wheel_inertia(model: pin.Model, robot: Robot) -> None:
    index = model.getJointId(robot.drive.wheels[0].joint)
    body = model.inertias[index]
    model.inertias[index] = pin.Inertia(body.mass, body.lever, np.zeros((3, 3)))


def gravity(vector: list[float]) -> Callable[[pin.Model, Robot], None]:
    def changed(model: pin.Model, robot: Robot) -> None:
        model.gravity.linear = np.array(vector)

    return changed


def rotor(model: pin.Model, robot: Robot) -> None:
    armature = model.armature.copy()
    armature[robot.velocity_index(robot.joints[-1].name)] = SMALL
    model.armature = armature


def body(
    mass: float = 1.0, lever: Callable[[pin.Inertia, pin.SE3], Array] | None = None
) -> Callable[[pin.Inertia, pin.SE3], pin.Inertia]:
    """Return the change of a body's mass by a factor, or of its centre of mass."""

    def changed(inertia: pin.Inertia, placement: pin.SE3) -> pin.Inertia:
        com = inertia.lever if lever is None else lever(inertia, placement)
        return pin.Inertia(inertia.mass * mass, com, inertia.inertia)

    return changed


def turned_inertia(inertia: pin.Inertia, placement: pin.SE3) -> pin.Inertia:
    R = placement.rotation
    return pin.Inertia(inertia.mass, inertia.lever, R.T @ inertia.inertia @ R)


def rounder(inertia: pin.Inertia, placement: pin.SE3) -> pin.Inertia:
    return pin.Inertia(inertia.mass, inertia.lever, inertia.inertia * (1.0 + SMALL))


MUTATIONS: dict[str, Injection] = {
    "h: Coriolis sign": in_method("bias", coriolis(-1.0)),
    "h: Coriolis 1e-6 larger": in_method("bias", coriolis(1.0 + SMALL)),
    "M: an entry 1e-6 smaller": in_method("inertia", scaled((0, 0), 1.0 - SMALL)),
    "M: not symmetric": in_method("inertia", scaled((1, -1))),
    "S: slip in turns": in_method("at", slipping),
    "Ṡν: classical acceleration": in_method("drift", drifting, LevelProjection),
    "B: sign of an arm joint": in_method("actuation", scaled((-1, -1), -1.0)),
    "B: sign of a wheel, everywhere": in_method("__init__", wheel_sign),
    "ν̇: 1e-6 larger": in_method("forward", scaled(slice(None))),
    "inverse: 1e-6 larger": in_method("inverse", scaled(slice(None))),
    "energy: 1% larger": in_method("energy", lambda f, *args: 1.01 * f(*args)),
    "W: P to the side": selection_of(point=lambda d: (d.point[0] + SMALL, d.point[1] + SMALL)),
    "W: heading": selection_of(heading=lambda d: d.heading + SECOND_ORDER),
    "W: two joints swapped": in_function(selection, swapped),
    "A: one wheel's radius": rolling_of(wheels(larger, 1)),
    "A: both wheels' radius": rolling_of(wheels(larger)),
    "A: contact at the top": rolling_of(wheels(upside_down)),
    "A: a wheel's centre": rolling_of(wheels(shifted, 1)),
    "A: contact ahead of the axle": in_function(rolling.find_rolling, ahead),
    "A: mimic ratio": rolling_of(mimic(1.0 + SMALL)),
    "A: mimic sign": rolling_of(mimic(-1.0)),
    "model: gravity 9.80665": in_model(gravity([0.0, 0.0, -9.80665])),
    "model: gravity tilted": in_model(gravity([SMALL * 9.81, 0.0, -9.81])),
    "model: wheel inertia dropped": in_model(without_wheel_inertia),
    "model: rotor inertia": in_model(rotor),
    "model: mass": in_body(body(mass=1.0 + SMALL)),
    "model: inertia": in_body(rounder),
    "model: inertia in other axes": in_body(turned_inertia),
    "model: CoM": in_body(body(lever=lambda b, _: b.lever + np.array([SMALL, 0.0, 0.0]))),
    "model: CoM in the parent's axes": in_body(body(lever=lambda b, at: at.rotation @ b.lever)),
    "model: joint moved": in_placement(
        lambda at: pin.SE3(at.rotation, at.translation + np.array([0.0, SMALL, 0.0]))
    ),
    "model: joint tilted": in_placement(
        lambda at: pin.SE3(at.rotation @ pin.exp3(np.full(3, SMALL)), at.translation)
    ),
    "model: joint transposed": in_placement(lambda at: pin.SE3(at.rotation.T, at.translation)),
}
