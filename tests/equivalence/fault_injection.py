"""Tools to plant an error in the dynamics or in a robot, for the time of a ``with``."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Any

import pinocchio as pin

from rpctl import Drive, ReducedDynamics, Robot
from rpctl.dynamics import rolling

Injection = Callable[[Robot], AbstractContextManager[Robot]]


def in_method(name: str, change: Callable[..., Any], owner: type = ReducedDynamics) -> Injection:
    """Plant ``change(original, dynamics, *arguments)`` in place of a method's result."""

    @contextmanager
    def inject(robot: Robot) -> Iterator[Robot]:
        original = getattr(owner, name)

        def changed(dynamics: Any, *arguments: Any) -> Any:
            return change(original, dynamics, *arguments)

        setattr(owner, name, changed)
        try:
            yield robot
        finally:
            setattr(owner, name, original)

    return inject


def in_function(original: Callable[..., Any], change: Callable[..., Any]) -> Injection:
    """Plant ``change(original, *arguments)`` wherever rpctl knows the function."""

    def changed(*arguments: Any) -> Any:
        return change(original, *arguments)

    @contextmanager
    def inject(robot: Robot) -> Iterator[Robot]:
        modules = [m for name, m in sys.modules.items() if name.split(".")[0] == "rpctl"]
        users = [(m, k) for m in modules for k, value in vars(m).items() if value is original]
        for module, name in users:
            setattr(module, name, changed)
        try:
            yield robot
        finally:
            for module, name in users:
                setattr(module, name, original)

    return inject


def in_model(change: Callable[[pin.Model, Robot], None]) -> Injection:
    """Plant a change of a copy of Pinocchio's model."""

    @contextmanager
    def inject(robot: Robot) -> Iterator[Robot]:
        model = robot.model.copy()
        change(model, robot)
        yield dataclasses.replace(robot, model=model)

    return inject


def in_body(change: Callable[[pin.Inertia, pin.SE3], pin.Inertia]) -> Injection:
    """Plant a change of the inertia behind the first arm joint, given the joint's placement."""

    def change_model(model: pin.Model, robot: Robot) -> None:
        index = model.getJointId(robot.joints[0].name)
        model.inertias[index] = change(model.inertias[index], model.jointPlacements[index])

    return in_model(change_model)


def in_placement(change: Callable[[pin.SE3], pin.SE3]) -> Injection:
    """Plant a change of the first arm joint's placement."""

    def change_model(model: pin.Model, robot: Robot) -> None:
        index = model.getJointId(robot.joints[0].name)
        model.jointPlacements[index] = change(model.jointPlacements[index])

    return in_model(change_model)


def rolling_of(change: Callable[[Robot], Robot]) -> Injection:
    """Plant another robot's rolling constraint: the equations get it, the oracles do not."""

    def changed(original: Callable[..., Any], robot: Robot, *rest: Any) -> Any:
        return original(change(robot), *rest)

    return in_function(rolling.find_rolling, changed)


def selection_of(**changes: Callable[[Drive], Any]) -> Injection:
    """Plant quasi-velocities of another drive."""

    def changed(original: Callable[..., Any], robot: Robot, *rest: Any) -> Any:
        values = {name: change(robot.drive) for name, change in changes.items()}
        drive = dataclasses.replace(robot.drive, **values)
        return original(dataclasses.replace(robot, drive=drive), *rest)

    return in_function(rolling.selection, changed)
