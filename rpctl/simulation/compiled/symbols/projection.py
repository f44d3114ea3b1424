"""The projection onto the quasi-velocities in symbols: S, Ṡν, B and its right inverse."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi
import numpy as np

from rpctl.dynamics.projection import Projector
from rpctl.simulation.compiled.symbols.linear import solve_positive
from rpctl.simulation.compiled.symbols.rolling import SymbolicBasis
from rpctl.simulation.compiled.symbols.scalars import (
    Scalar,
    column,
    dot,
    entries,
    matrix,
    product,
    times,
    transposed,
)


class SymbolicProjection:
    """What rolling makes of velocities and efforts at one configuration, in symbols.

    Args:
        projector: That of the robot.
        basis: S at the configuration.
        varied: Whether S is not the same in all robots of the graph.

    Attributes:
        rows: Rows of S.
        columns: Its columns.
    """

    def __init__(self, projector: Projector, basis: SymbolicBasis, varied: bool) -> None:
        self._projector, self._basis, self._varied = projector, basis, varied
        self.rows = basis.S
        self.columns = transposed(basis.S)

    @cached_property
    def S(self) -> Any:
        """Basis ``casadi.SX`` (nv, dof), sparse where it is constantly 0."""
        return matrix(self.rows)

    @cached_property
    def B(self) -> Any:
        """Actuation map ``casadi.SX`` (dof, n_act), likewise."""
        return matrix(self.actuation)

    @cached_property
    def actuation(self) -> list[list[Scalar]]:
        """Rows of B."""
        robot = self._projector.robot
        return transposed([self.rows[robot.velocity_index(name)] for name in robot.actuators])

    @property
    def margin(self) -> Any:
        """How far the steering is from a singular one, of 1; 1 where S is constant."""
        return casadi.SX(self._basis.margin)

    @cached_property
    def allocation(self) -> Any:
        """Right inverse of B (n_act, dof) of least efforts relative to their limits."""
        units = np.eye(self._projector.robot.dof).tolist()
        return matrix(transposed([self.allocated(unit) for unit in units]))

    def allocated(self, force: list[Scalar]) -> list[Scalar]:
        """Return the entries of the τ of least effort with B τ = ``force``.

        Raises:
            ActuationError: Actuators do not drive all quasi-velocities.
        """
        projector = self._projector
        if projector.constant is not None and not self._varied:
            return product(projector.constant.allocation.tolist(), force)
        regular = projector.robot.random_configuration(np.random.default_rng(0))
        _ = projector.at(regular).allocation  # refuses what nothing drives
        limits = projector.robot.effort_limits
        squares = (np.where(np.isfinite(limits), limits, 1.0) ** 2).tolist()
        B = self.actuation
        weighted = [[times(b, square) for b, square in zip(row, squares, strict=True)] for row in B]
        gram = [[dot(a, b) for b in B] for a in weighted]
        return product(transposed(weighted), solve_positive(gram, force))

    def drift(self, nu: Any) -> Any:
        """Return Ṡν (nv, 1)."""
        return column(self.drifting(entries(nu)))

    def drifting(self, nu: list[Scalar]) -> list[Scalar]:
        """Return the entries of Ṡν."""
        return self._basis.drift(product(self.rows, nu))
