"""All the numbers of a robot that its dynamics are made of, and which of them may differ."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rpctl import math as casadi  # imported when a function is asked for
from rpctl.arrays import Array
from rpctl.drive.rows import TurningMatrix
from rpctl.drive.scaled_wheels import scale_track
from rpctl.dynamics.projection import eliminate, rows_to_solve
from rpctl.dynamics.rolling import basis, find_rolling, selection
from rpctl.dynamics.symbols.bodies import ZZ, MovingBody, felt, inertias_of, moving_bodies
from rpctl.errors import RpctlError
from rpctl.kernels.scalars import cleaned
from rpctl.robot.coordinates import ROOT_JOINT
from rpctl.robot.losses import SLIDING_RATE, TURNING_RATE, Losses
from rpctl.robot.model import Robot
from rpctl.robot.variation import BuiltNumbers

# Of an array's largest entry: numbers that differ by less are the same, and those of one graph,
# whose robots may be farther apart than those that it was made for.
CHANGED, SAME = 1e-13, 1e-11


class RobotNumbers:
    """Reads the numbers of a robot and of others of the same structure.

    Args:
        robot: The robot.
        bodies: Its bodies.
        others: Robots of which some numbers differ; None: none do.
        gliding: Joints of swivels that glide.

    Attributes:
        nominal: The robot's own, by name.
        varied: Which of them differ, by name.
    """

    def __init__(
        self,
        robot: Robot,
        bodies: Sequence[MovingBody],
        others: BuiltNumbers | None = None,
        gliding: Collection[str] = (),
    ) -> None:
        self.robot, self.bodies, self._gliding = robot, bodies, gliding
        self._places, self._rows = _places(robot), rows_to_solve(*self._matrices(robot))
        inertias = inertias_of(robot)[None]
        if others is not None:
            inertias = np.concatenate([inertias, others.bodies])
        inertia = np.abs([cleaned(each) for each in felt(bodies, inertias)]).max(axis=0)
        unlike = np.count_nonzero(np.delete(inertia, ZZ, axis=1), axis=1)
        carriers = {body.parent for body in bodies}
        self._round = np.array(
            [
                not (unlike[i] or body.slides or i in carriers or body.entry is None)
                for i, body in enumerate(bodies)
            ]
        )
        self.nominal = {name: cleaned(array) for name, array in self.of(robot).items()}
        stacks = {} if others is None else self.built(others)
        self.varied = {
            name: _changed(stacks.get(name, array[None])) for name, array in self.nominal.items()
        }

    def of(self, robot: Robot) -> dict[str, Array]:
        """Return the numbers of a robot, by name.

        Raises:
            RpctlError: It has other joints.
        """
        if list(robot.model.names) != list(self.robot.model.names):
            raise RpctlError(f"{robot.name} is no variant of {self.robot.name}: its joints differ")
        places = _places(robot)
        moved = not np.array_equal(places, self._places)
        bodies = moving_bodies(robot) if moved else self.bodies
        places[self._round] = 0.0  # where a round wheel is, its carrier's inertia has
        still, losses = np.zeros(self.robot.nv), robot.losses
        if losses is None:
            rate = np.full(self.robot.nv, TURNING_RATE)
            rate[[body.index for body in self.bodies if body.slides]] = SLIDING_RATE
            losses = Losses(still, still, rate)
        found = {"inertia": felt(bodies, inertias_of(robot)), "place": places}
        found |= {"damping": losses.damping, "friction": losses.friction, "rate": losses.rate}
        found |= {
            "armature": robot.armature,
            "lift": -np.array(robot.model.gravity.linear),
            "point": np.array([*robot.drive.point, robot.drive.heading]),
        }
        return found | rolling_numbers(*self._matrices(robot), self._rows)

    def built(self, others: BuiltNumbers) -> dict[str, Array]:
        """Return the numbers (K, ...) in which K robots may differ from theirs, by name."""
        found = {"inertia": felt(self.bodies, others.bodies), "lift": -others.gravity}
        found |= {"damping": others.damping, "friction": others.friction}
        return found | self._built_rolling(others)

    def _built_rolling(self, others: BuiltNumbers) -> dict[str, Array]:
        """Return what :func:`rolling_numbers` names, in stacks (K, ...).

        A and W are linear in the radii and in the track, so a few robots have those of all.
        """
        robot, drive = others.robot, others.robot.drive
        own = np.array([*(wheel.radius for wheel in drive.wheels), 1.0])

        def matrices(settings: Array) -> tuple[TurningMatrix, Array]:
            """Return A and W of a robot with other radii, and another scale of its track."""
            radii = zip(drive.wheels, settings[:-1].tolist(), strict=True)
            other = replace(drive, wheels=tuple(replace(w, radius=r) for w, r in radii))
            other = scale_track(other, robot.tree, settings[-1])
            return self._matrices(replace(robot, drive=other))

        asked = np.column_stack([others.radii, others.track])
        different, which = np.unique(asked, axis=0, return_inverse=True)
        A, W = matrices(own)
        moved = np.flatnonzero((asked != own).any(axis=0)).tolist()
        doubled = [matrices(own * (1.0 + np.eye(len(own))[k])) for k in moved]
        numbers = []
        for shares in (different / own - 1.0)[:, moved].tolist():
            constant, harmonics, V = A.constant.copy(), A.harmonics.copy(), W.copy()
            for share, (a, w) in zip(shares, doubled, strict=True):
                constant += share * (a.constant - A.constant)
                harmonics += share * (a.harmonics - A.harmonics)
                V += share * (w - W)
            turning = replace(A, constant=constant, harmonics=harmonics)
            numbers.append(rolling_numbers(turning, V, self._rows))
        stacks = {name: np.stack([each[name] for each in numbers]) for name in numbers[0]}
        return {name: stack[which.ravel()] for name, stack in stacks.items()}

    def _matrices(self, robot: Robot) -> tuple[TurningMatrix, Array]:
        """Return A and W of a robot."""
        rolling = find_rolling(robot, self._gliding)
        return rolling.matrix, selection(robot, rolling)

    @cached_property
    def symbols(self) -> Any:
        """``casadi.SX`` (n, 1) of what differs, array after array."""
        return casadi.SX.sym("p", sum(int(mask.sum()) for mask in self.varied.values()))

    def scalars(self) -> dict[str, Any]:
        """Return the numbers as nested lists of floats and symbols, by name."""
        symbols = iter(casadi.vertsplit(self.symbols))
        arrays = self.nominal.items()
        return {name: _nested(array, self.varied[name], symbols) for name, array in arrays}

    def values(self, numbers: Mapping[str, Array]) -> Array:
        """Return the values (n,) of the symbols that stand for other numbers.

        Args:
            numbers: By name, the robot's own where none are given; stacks of them (..., shape)
                give values (..., n).

        Raises:
            RpctlError: They differ in more than symbols stand for.
        """
        found = []
        for name, nominal in self.nominal.items():
            mask, array = self.varied[name], numbers.get(name, nominal)
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


def _changed(stack: Array) -> NDArray[np.bool_]:
    """Return which entries are not the same in all rows."""
    change = np.abs(stack - stack[0]).max(axis=0)
    return np.asarray(change > CHANGED * np.abs(stack).max(initial=0.0))


def _places(robot: Robot) -> Array:
    """Return the poses (n, 4, 4) of the joints in the axes of those before them."""
    joints = list(robot.model.jointPlacements)[ROOT_JOINT:]
    return np.array([placement.homogeneous for placement in joints])


def rolling_numbers(A: TurningMatrix, W: Array, solved: NDArray[np.intp]) -> dict[str, Array]:
    """Return the constants of which S and Ṡν are made, by name.

    Args:
        A: Constraint matrix (rows, nv).
        W: Selection of the quasi-velocities (dof, nv).
        solved: Rows of [A; W] that are solved before a configuration is known.
    """
    if not A.harmonics.any():
        return {"S": basis(A.constant, W)}
    core, N, P, R, C = eliminate(A, W, solved)
    arrays = {"constant": core.constant, "harmonics": core.harmonics, "N": N, "P": P}
    arrays |= {"R": R, "C": C, "A": A.harmonics}
    return arrays | {"cosine": np.cos(core.phase), "sine": np.sin(core.phase)}


def _nested(values: Any, varied: Any, symbols: Iterator[Any]) -> Any:
    """Return an array as nested lists, the next symbol in the place of each entry that varies."""
    if values.ndim:
        rows = zip(values, varied, strict=True)
        return [_nested(row, mask, symbols) for row, mask in rows]
    return next(symbols) if varied else float(values)
