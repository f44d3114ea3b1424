"""The numbers among the settings of laws: inputs of what is compiled, so none compiles anew."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import casadi
import numpy as np

from rpctl.arrays import Array
from rpctl.control.bounded import BoundedDynamic
from rpctl.control.dynamic import PaperDynamic
from rpctl.control.integral import IntegralDynamic
from rpctl.control.twist_law import BaseLaw
from rpctl.dynamics.reduced import ReducedDynamics

ClosedFormDynamic = PaperDynamic | BoundedDynamic | IntegralDynamic


def settings_of(
    kinematic: BaseLaw, dynamic: ClosedFormDynamic, known: ReducedDynamics, period: float
) -> tuple[tuple[str, ...], Array]:
    """Return the names and the values of all numbers among two laws' settings.

    Laws of the same structure have the same names, in the same order.

    Args:
        kinematic: The kinematic law.
        dynamic: The dynamic law.
        known: The robot's dynamics, as far as the controller knows them.
        period: Control period, s.

    Raises:
        RpctlError: A setting does not fit the robot or the period.
    """
    found = {**_kinematic(kinematic, known, period), **_dynamic(dynamic, known, period)}
    return tuple(found), np.array(list(found.values()))


def symbols_of(names: Sequence[str], column: Any) -> Mapping[str, Any]:
    """Return the entries of a column of settings by name.

    Args:
        names: Names of the entries.
        column: ``casadi.SX`` (n, 1).
    """
    return dict(zip(names, casadi.vertsplit(column), strict=True))


def by_name(s: Mapping[str, Any], kind: str, names: Iterable[str]) -> Any:
    """Return a column of settings of one kind.

    Args:
        s: All settings.
        kind: Which.
        names: Whose, in order.
    """
    return casadi.vertcat(*(s[f"{kind}.{name}"] for name in names), casadi.SX(0, 1))


def _kinematic(law: BaseLaw, known: ReducedDynamics, period: float) -> dict[str, float]:
    found = {
        item.name: float(getattr(law, item.name))
        for item in dataclasses.fields(law)
        if item.name not in ("joint_horizon", "leash", "approach")
    }
    if law.leash is not None:
        found |= {f"leash.{name}": value for name, value in dataclasses.asdict(law.leash).items()}
    joints = known.robot.joint_names
    return found | _each("joint_horizon", joints, law.joint_horizons(known, period))


def _dynamic(law: ClosedFormDynamic, known: ReducedDynamics, period: float) -> dict[str, float]:
    names = known.robot.quasi_velocities
    if isinstance(law, PaperDynamic):
        return _each("time", names, law.start(known, period).times)
    if isinstance(law, BoundedDynamic):
        started = law.start(known, period)
        found = {"horizon_dyn": law.horizon_dyn, "along": law.along}
        found |= _each("time", names, started.times)
        return found | _each("root_weight", names, started.root_weights)
    gain = law.start(known, period).gain
    return _dynamic(law.inner, known, period) | _each("gain", names, gain)


def _each(kind: str, names: Sequence[str], values: Array) -> dict[str, float]:
    return {f"{kind}.{name}": float(value) for name, value in zip(names, values, strict=True)}
