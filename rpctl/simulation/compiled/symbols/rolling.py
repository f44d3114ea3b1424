"""S and Ṡν in symbols: constant where no wheel swivels, else solved for at each q.

Few equations are left where wheels swivel, see :func:`rpctl.dynamics.projection.eliminate`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rpctl.arrays import Array
from rpctl.dynamics.projection import Projector
from rpctl.robot.coordinates import JointEntry
from rpctl.simulation.compiled.symbols.configuration import SymbolicConfiguration
from rpctl.simulation.compiled.symbols.linear import BlockSolver
from rpctl.simulation.compiled.symbols.scalars import Scalar, Vector, dot, product, times, total

SINGULAR = 1e-6  # a smaller margin is left to Python: :class:`ReducedDynamics` refuses at 1e-9
Matrix = Sequence[Vector]


class SymbolicBasis:
    """S, and what Ṡν is made of, at one configuration.

    Args:
        projector: That of the robot.
        numbers: Those of ``rolling_numbers``, as floats or symbols, nested as the arrays are.
        at: The configuration.
        swivels: Entries in q of the swivels' joints.
    """

    def __init__(
        self,
        projector: Projector,
        numbers: Mapping[str, Any],
        at: SymbolicConfiguration,
        swivels: Sequence[JointEntry],
    ) -> None:
        self._projector, self._numbers = projector, numbers
        self.margin: Scalar = 1.0
        self._solver: BlockSolver | None = None
        if projector.constant is not None:
            self.S: Matrix = numbers["S"]
            return
        core = projector.equations.core
        n = len(numbers["R"])
        pairs = [at.pair(entry) for entry in swivels]
        self._waves = _waves(core.G, numbers["cosine"], numbers["sine"], pairs)
        both = [
            [
                total((entry, *(times(w, H[r][c]) for w, H in self._harmonics("harmonics"))))
                for c, entry in enumerate(row)
            ]
            for r, row in enumerate(numbers["constant"])
        ]
        self._X = both[n:]
        self._solver = BlockSolver(both[:n], core.bound[:n])
        self.margin = self._solver.margin
        columns = [self._solver.solve(list(b)) for b in zip(*numbers["R"], strict=True)]
        self.S = [
            [total((c, dot(x, y))) for c, y in zip(row, columns, strict=True)]
            for x, row in zip(self._X, numbers["C"], strict=True)
        ]

    def _harmonics(self, name: str) -> list[tuple[Scalar, Matrix]]:
        cosines, sines = self._waves
        return list(zip([*cosines, *sines], self._numbers[name], strict=True))

    def drift(self, v: Vector) -> list[Scalar]:
        """Return Ṡν (nv,) at v = S ν (nv,)."""
        if self._solver is None:
            return [0.0] * len(v)
        rolling = self._projector.rolling
        rates = [v[i] for i in rolling.index.tolist()]
        turning = [dot(row, rates) for row in self._projector.equations.core.G.tolist()]
        cosines, sines = self._waves
        changes = [times(-rate, s) for rate, s in zip(turning, sines, strict=True)]
        changes += [times(rate, c) for rate, c in zip(turning, cosines, strict=True)]
        rows = range(len(rolling.matrix.constant))
        slip = [
            -total(
                times(change, dot(H[r], v))
                for change, H in zip(changes, self._numbers["A"], strict=True)
            )
            for r in rows
        ]
        y = self._solver.solve(product(self._numbers["N"], slip))
        rest = product(self._numbers["P"], slip)
        return [total((dot(x, y), other)) for x, other in zip(self._X, rest, strict=True)]


def _waves(
    G: Array, cosine: Vector, sine: Vector, pairs: Sequence[tuple[Scalar, Scalar]]
) -> tuple[list[Scalar], list[Scalar]]:
    """Return cosines and sines of phase + G p, of which each entry is 0 or ±1."""
    cosines, sines = [], []
    for row, c, s in zip(G.tolist(), cosine, sine, strict=True):
        for sign, (x, y) in zip(row, pairs, strict=True):
            if sign:
                y = times(sign, y)
                c, s = (
                    total((times(c, x), times(-s, y))),
                    total((times(s, x), times(c, y))),
                )
        cosines.append(c)
        sines.append(s)
    return cosines, sines
