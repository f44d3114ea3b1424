"""All the numbers of a robot that its dynamics are made of, and which of them may differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.dynamics.projection import eliminate, rows_to_solve
from rpctl.dynamics.rolling import basis, find_rolling, selection
from rpctl.dynamics.symbols.bodies import (
    NUMBERS,
    ZZ,
    MovingBody,
    felt,
    inertias_of,
    moving_bodies,
)
from rpctl.errors import RpctlError, UnknownNameError
from rpctl.kernels.scalars import cleaned
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.losses import SLIDING_RATE, TURNING_RATE, Losses
from rpctl.robot.model import Robot


class RobotNumbers:
    """Reads the numbers of a robot and of others of the same structure.

    Args:
        robot: The robot.
        bodies: Its bodies.

    Attributes:
        nominal: The robot's own, by name.
    """

    def __init__(self, robot: Robot, bodies: Sequence[MovingBody]) -> None:
        self.robot, self.bodies = robot, bodies
        self._places, self._rows = _places(robot), solved_rows(robot)
        inertia = cleaned(felt(bodies, inertias_of(robot)))
        unlike = np.count_nonzero(np.delete(inertia, ZZ, axis=1), axis=1)
        carriers = {body.parent for body in bodies}
        self._round = np.array(
            [
                not (unlike[i] or body.slides or i in carriers or body.entry is None)
                for i, body in enumerate(bodies)
            ]
        )
        self.nominal = {name: cleaned(array) for name, array in self.of(robot).items()}

    def of(self, robot: Robot, inertias: Array | None = None) -> dict[str, Array]:
        """Return the numbers of a robot, by name.

        Args:
            robot: The robot.
            inertias: Pseudo-inertias of the bodies (..., n, 4, 4) in the axes of Pinocchio's
                joints, in stacks; None: the robot's own.

        Raises:
            RpctlError: It has other joints.
        """
        if list(robot.model.names) != list(self.robot.model.names):
            raise RpctlError(f"{robot.name} is no variant of {self.robot.name}: its joints differ")
        places = _places(robot)
        moved = not np.array_equal(places, self._places)
        bodies = moving_bodies(robot) if moved else self.bodies
        own = inertias_of(robot) if inertias is None else inertias
        places[self._round] = 0.0  # where a round wheel is, its carrier's inertia has
        still, losses = np.zeros(self.robot.nv), robot.losses
        if losses is None:
            rate = np.full(self.robot.nv, TURNING_RATE)
            rate[[body.index for body in self.bodies if body.slides]] = SLIDING_RATE
            losses = Losses(still, still, rate)
        found = {"inertia": felt(bodies, own), "place": places}
        found |= {"damping": losses.damping, "friction": losses.friction, "rate": losses.rate}
        found |= {
            "armature": robot.armature,
            "lift": -np.array(robot.model.gravity.linear),
            "point": np.array([*robot.drive.point, robot.drive.heading]),
        }
        return found | rolling_numbers(robot, self._rows)

    def varied(self, varied: Varied) -> dict[str, NDArray[np.bool_]]:
        """Return which of the numbers are not the same in all robots, by name.

        Raises:
            UnknownNameError: No joint has such a name.
        """
        for name in (*varied.bodies, *varied.losses):
            if name not in (body.joint for body in self.bodies):
                raise UnknownNameError("joint", name, [body.joint for body in self.bodies])
        lossy = np.zeros(self.robot.nv, bool)
        lossy[[self.robot.velocity_index(name) for name in varied.losses]] = True
        found = {"damping": lossy, "friction": lossy, "inertia": self._varied_inertias(varied)}
        found["lift"] = np.full(3, varied.slope)
        return found | (varied_rolling(self.robot) if varied.rolling else {})

    def _varied_inertias(self, varied: Varied) -> NDArray[np.bool_]:
        """Return which of the felt numbers (n, 10) change with those of some bodies."""
        changes = []
        for i, body in enumerate(self.bodies):
            if body.joint not in varied.bodies:
                continue
            for kind in _round_inertias(body) if self._round[i] else INERTIAS:
                change = np.zeros((len(self.bodies), 4, 4))
                change[i] = kind
                changes.append(felt(self.bodies, change))
        pattern = np.abs(changes).max(axis=0, initial=0.0) if changes else 0.0
        return np.broadcast_to(pattern > 1e-12, (len(self.bodies), NUMBERS))


def _places(robot: Robot) -> Array:
    """Return the poses (n, 4, 4) of the joints in the axes of those before them."""
    joints = list(robot.model.jointPlacements)[ROOT_JOINT:]
    return np.array([placement.homogeneous for placement in joints])


def _round_inertias(body: MovingBody) -> list[Array]:
    """Return the pseudo-inertias of which that of a body, round about its joint, is a sum."""
    axis = np.append(body.frame[:3, 2], 0.0)
    origin = np.array([0.0, 0.0, 0.0, 1.0])
    along, all_round = np.outer(axis, axis), np.diag([1.0, 1.0, 1.0, 0.0])
    return [np.outer(origin, origin), _mixed(axis, origin), along, all_round - along]


def _mixed(a: Array, b: Array) -> Array:
    return np.outer(a, b) + np.outer(b, a)


INERTIAS = [_mixed(np.eye(4)[i], np.eye(4)[j]) for i in range(4) for j in range(i + 1)]


# Factors of a robot that differs in everything that may vary: no two quotients of them are alike.
RADIUS, PLACE, PIVOT, TRAIL, LATERAL, SHIFT = 1.037, 1.017, 1.013, 1.029, 1.023, 1.041
CHANGED = 1e-9  # of an array's largest entry: less is rounding


def rolling_numbers(robot: Robot, solved: NDArray[np.intp] | None = None) -> dict[str, Array]:
    """Return the constants of which S and Ṡν are made, by name.

    Args:
        robot: The robot.
        solved: Rows that are solved first, see :func:`solved_rows`; None: the robot's own.
    """
    rolling = find_rolling(robot)
    A, W = rolling.matrix, selection(robot, rolling)
    if not A.harmonics.any():
        return {"S": basis(A.constant, W)}
    core, N, P, R, C = eliminate(A, W, solved)
    arrays = {"constant": core.constant, "harmonics": core.harmonics, "N": N, "P": P}
    arrays |= {"R": R, "C": C, "A": A.harmonics}
    return arrays | {"cosine": np.cos(core.phase), "sine": np.sin(core.phase)}


def solved_rows(robot: Robot) -> NDArray[np.intp]:
    """Return the rows of [A; W] that are solved before a configuration is known."""
    rolling = find_rolling(robot)
    return rows_to_solve(rolling.matrix, selection(robot, rolling))


def varied_rolling(robot: Robot) -> dict[str, NDArray[np.bool_]]:
    """Return which of the numbers change with radii, track, trails and pivots, by name.

    What is 0, as the way of a wheel's centre off the axle, stays 0.
    """
    rows = solved_rows(robot)
    nominal, other = rolling_numbers(robot, rows), rolling_numbers(_otherwise(robot), rows)
    return {
        name: np.abs(other[name] - array) > CHANGED * np.abs(array).max()
        for name, array in nominal.items()
    }


def _otherwise(robot: Robot) -> Robot:
    """Return a robot of another rolling geometry."""
    drive, model = robot.drive, robot.model.copy()
    for name in (*(w.joint for w in drive.wheels), *(s.joint for s in drive.swivels)):
        placement = model.jointPlacements[model.getJointId(name)]
        placement.translation = PLACE * placement.translation
    wheels = (
        replace(
            wheel,
            radius=RADIUS * wheel.radius,
            lateral=LATERAL * wheel.lateral,
            shift=SHIFT * wheel.shift,
        )
        for wheel in drive.wheels
    )
    swivels = (
        replace(
            swivel,
            pivot=(PIVOT * swivel.pivot[0], PIVOT * swivel.pivot[1]),
            trail=TRAIL * swivel.trail,
        )
        for swivel in drive.swivels
    )
    other = replace(drive, wheels=tuple(wheels), swivels=tuple(swivels))
    return replace(robot, drive=other, model=model)


SAME = 1e-12  # of an array's largest entry: numbers so near to each other are the same


@dataclass(frozen=True)
class Varied:
    """What is not the same in all the robots that one graph is for.

    Attributes:
        bodies: Joints whose bodies (all links up to the next joints) have other masses, centres or
            inertias; ``"root_joint"`` is the base.
        rolling: Whether radii, track, trails or pivots differ.
        losses: Joints whose damping or friction differs.
        slope: Whether the slope of the ground differs.
    """

    bodies: tuple[str, ...] = ()
    rolling: bool = False
    losses: tuple[str, ...] = ()
    slope: bool = False


NOTHING = Varied()


class Parameters:
    """Arrays of numbers by name, of which some entries are symbols.

    Args:
        numbers: The arrays of the robot that the graph is made for.
        varied: Which of their entries are symbols; none of those left out.

    Attributes:
        symbols: ``casadi.SX`` (n, 1), array after array.
    """

    def __init__(
        self, numbers: Mapping[str, Array], varied: Mapping[str, NDArray[np.bool_]]
    ) -> None:
        self._numbers = dict(numbers)
        self._varied = {
            name: varied.get(name, np.zeros(array.shape, bool)) for name, array in numbers.items()
        }
        self.symbols = casadi.SX.sym("p", sum(int(mask.sum()) for mask in self._varied.values()))

    def scalars(self) -> dict[str, Any]:
        """Return the arrays as nested lists of floats and symbols, by name."""
        symbols = iter(casadi.vertsplit(self.symbols))
        return {
            name: _nested(array, self._varied[name], symbols)
            for name, array in self._numbers.items()
        }

    def values(self, numbers: Mapping[str, Array]) -> Array:
        """Return the values (n,) of the symbols that stand for other arrays of the same shapes.

        Args:
            numbers: Arrays by name; stacks of them (..., shape) give values (..., n).

        Raises:
            RpctlError: They differ in more than symbols stand for.
        """
        found = []
        for name, nominal in self._numbers.items():
            mask, array = self._varied[name], numbers[name]
            change = np.abs(array - nominal)[..., ~mask]
            if change.max(initial=0.0) > SAME * np.abs(nominal).max(initial=1.0):
                raise RpctlError(
                    f"the variant differs from its robot in more than what is varied ({name})"
                )
            found.append(array[..., mask])
        stack = np.broadcast_shapes(*(values.shape[:-1] for values in found))
        return np.concatenate(
            [np.broadcast_to(values, (*stack, values.shape[-1])) for values in found], axis=-1
        )


def _nested(values: Any, varied: Any, symbols: Iterator[Any]) -> Any:
    """Return an array as nested lists, the next symbol in the place of each entry that varies."""
    if values.ndim:
        rows = zip(values, varied, strict=True)
        return [_nested(row, mask, symbols) for row, mask in rows]
    return next(symbols) if varied else float(values)
