"""What each lane of a compiled loop begins with, and what it has of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics


@dataclass(frozen=True, eq=False)
class LaneInputs:
    """K runs of one robot, a row each; all start at rest.

    Attributes:
        q: Configurations at the start (K, nq).
        errors: Tracking errors of the base there (K, 3), m, m, rad.
        rest: Efforts that hold the robot there (K, n_act), N·m or N, less the bias.
        bias: Efforts that push besides the controller's (K, n_act), N·m or N.
        p: Parameters of the simulated robot (K, n_p).
        settings: Of the laws (K, n_s).
        most: Efforts at which the true actuators saturate (K, n_act), N·m or N.
        back: By how many control periods efforts are late (K,).
        deviations: Of the noise (K, n_noise), see :class:`rpctl.simulation.noise.Sensors`.
        offsets: Constant errors of what is measured (K, n_noise).
        seeds: Of the plants (K,), from which the noise follows.
    """

    q: Array
    errors: Array
    rest: Array
    bias: Array
    p: Array
    settings: Array
    most: Array
    back: NDArray[np.int64]
    deviations: Array
    offsets: Array
    seeds: tuple[int, ...]

    def __len__(self) -> int:
        """Return the number of runs."""
        return len(self.q)

    def rows(self, chosen: slice | NDArray[np.intp]) -> LaneInputs:
        """Return some of the runs."""
        arrays = {name: value[chosen] for name, value in vars(self).items() if name != "seeds"}
        numbers = np.arange(len(self))[chosen].tolist()
        return LaneInputs(**arrays, seeds=tuple(self.seeds[k] for k in numbers))


def holding(dynamics: SymbolicDynamics) -> Any:
    """Return the ``casadi.Function`` of q and p that gives the efforts (n_act, 1) at a stand."""
    q = casadi.SX.sym("q", dynamics.robot.nq)
    force = dynamics.bias(q, casadi.SX(dynamics.robot.dof, 1))
    efforts = casadi.densify(casadi.SX(dynamics.efforts(q, force)))
    return casadi.Function("holding", [q, dynamics.p], [efforts])
