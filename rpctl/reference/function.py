"""A reference from a plain function of time; its derivatives are taken here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.errors import RpctlError, require_positive
from rpctl.reference.formula import Along, Columns, Numbers
from rpctl.reference.motion import RowReference, require_reference, shown
from rpctl.reference.paths import posed

STEP_S = 0.01  # s; error of the first derivative ~ STEP⁶, rounding in the second ~ 1e-16 / STEP²
KNOWN = 8  # formulas that are kept
REACH = 3  # steps to either side of the middle of a stencil
NODES = np.arange(-REACH, REACH + 1.0)  # of a stencil, in steps
TO_COEFFICIENTS = np.linalg.inv(np.vander(NODES, increasing=True))  # of the polynomial through them
MIN_TANGENT_SPEED = 1e-6  # m/s; below, a path has no direction that could be a heading


def as_reference(
    function: Callable[[float], Sequence[float] | Array],
    *,
    joints: Sequence[float] | Array | None = None,
    along_path: bool = False,
    duration: float | None = None,
) -> FunctionReference:
    """Return the reference that a function of time describes.

    Derivatives are those of the sixth-degree polynomial through seven values of the function,
    10 ms apart; the function is never called before t = 0 or after the end. For a smooth function
    they are accurate to about 1e-9; near jumps and sharp bends they are wrong.

    Args:
        function: Takes the time t (s) and returns the pose of P and the arm's positions
            (3 + n_joints,): x and y (m), heading (rad; it may jump by full turns), joints (rad or
            m, in the order of ``robot.joint_names``).
        joints: Constant positions of the arm (n_joints,), rad or m; the function then returns no
            joints.
        along_path: Whether the heading is the direction of motion; the function then returns no
            heading, only x and y, then the joints.
        duration: Duration, s; afterwards the reference stands still at its last pose. None: it has
            no end.

    Returns:
        The reference; called with a time (s) it returns a :class:`ReferenceState`.

    Raises:
        RpctlError: ``function`` cannot be called, or the duration is less than 60 ms.
    """
    return FunctionReference(function, joints, along_path, duration)


class FunctionReference(RowReference):
    """A :data:`Reference` that a function describes; see :func:`as_reference` for the arguments."""

    def __init__(
        self,
        function: Callable[[float], Sequence[float] | Array],
        joints: Sequence[float] | Array | None,
        along_path: bool,
        duration: float | None,
    ) -> None:
        require_reference(function)
        if isinstance(joints, Mapping):
            raise RpctlError("joints is a mapping; give positions in the order of joint_names")
        if duration is not None:
            require_positive("duration", duration)
            if duration < 2 * REACH * STEP_S:
                raise RpctlError(
                    f"a reference of {duration:g} s is too short to differentiate; "
                    f"give at least {2 * REACH * STEP_S:g} s"
                )
            self.duration = duration
        self._end = np.inf if duration is None else duration
        self._function = function
        known = np.array([] if joints is None else joints, dtype=float)
        self._arm = np.concatenate([known, np.zeros(2 * len(known))])
        self._stays, self._along_path = joints is not None, along_path
        self.__name__ = str(getattr(function, "__name__", type(function).__name__))

    def row(self, t: Numbers) -> Array:
        """Return its row (width,) at a time (s), or a row for each of the times (K,).

        Raises:
            RpctlError: The function returns something else than it has to.
        """
        within = np.clip(t, 0.0, self._end)
        middle = np.clip(within, REACH * STEP_S, self._end - REACH * STEP_S)
        values = [self._sample(at) for at in np.add.outer(middle, STEP_S * NODES).ravel().tolist()]
        count = len(values[0])
        if any(len(value) != count for value in values):
            raise RpctlError(
                f"the reference {self.__name__} returns a varying number of values; return the "
                "same number at all times"
            )
        samples = np.reshape(values, (*np.shape(t), -1))
        columns = _columns(count, self._along_path, self._stays)
        found = columns(within - middle, np.less_equal(t, self._end), samples)
        if self._along_path:
            self._require_motion(found[..., -1], t)
        arm = np.broadcast_to(self._arm, (*np.shape(t), len(self._arm)))
        return np.concatenate([found[..., :9], arm, found[..., 9:-1]], axis=-1)

    def _require_motion(self, speed: Array, t: Numbers) -> None:
        """Refuse a path that stands still: it has no direction that could be a heading."""
        stands = np.atleast_1d(speed < MIN_TANGENT_SPEED)
        if stands.any():
            first = np.atleast_1d(t)[int(stands.argmax())]
            raise RpctlError(
                f"the reference {self.__name__} stands still at t = {first:.4g} s, so it has no "
                "direction of motion; return a heading, without along_path"
            )

    def _sample(self, t: float) -> Array:
        """Return the function's values at one time, checked."""
        least = 2 if self._along_path else 3
        what = "x, y" if self._along_path else "x, y, heading (x, y alone with along_path=True)"
        what += "" if self._stays else ", then the arm's joints (none with joints=)"
        value = self._function(t)
        try:
            numbers = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            numbers = np.empty(0)
        if numbers.ndim != 1 or len(numbers) < least or not np.isfinite(numbers).all():
            raise RpctlError(
                f"the reference {self.__name__} returns {shown(value)} at t = {t:.4g} s; "
                f"return finite numbers: {what}"
            )
        return numbers


@lru_cache(maxsize=KNOWN)
def _columns(count: int, along_path: bool, stays: bool) -> Columns:
    """Return the row, then the speed, by the time since the middle of a stencil.

    Its other inputs are 1, or 0 of a reference that has ended, and the function's values (7 n,).

    Args:
        count: Numbers n that the function returns.
        along_path: Whether the heading is the direction of motion.
        stays: Whether the row has no joints, as they are known.
    """
    moving, samples = math.SX.sym("moving"), math.SX.sym("samples", len(NODES) * count)
    at = Along(moving, samples)
    given = [[samples[k] for k in range(i, len(NODES) * count, count)] for i in range(count)]
    if not along_path:
        heading = given[2]
        for k in range(1, len(NODES)):
            heading[k] = heading[k - 1] + math.remainder(heading[k] - heading[k - 1], 2.0 * np.pi)
    x, y, *others = (_polynomial(at.x / STEP_S, each) for each in given)
    heading = math.atan2(at.rate(y), at.rate(x)) if along_path else others.pop(0)
    place = posed(at, (x, y, heading))
    speeds = [moving * each for each in at.orders(place.twist, 2)]
    arm = [] if stays else others
    rates = [moving * each for each in at.orders(arm)[len(arm) :]]
    row = [*place.pose, *speeds, *arm, *rates, *speeds, 0.0, 0.0, 0.0]
    return at.columns([*row, math.sqrt(at.rate(x) ** 2 + at.rate(y) ** 2)])


def _polynomial(u: Any, values: Sequence[Any]) -> Any:
    """Return the polynomial of sixth degree through values (7,) at ``NODES``, at u steps."""
    found = 0.0
    for weights in TO_COEFFICIENTS[::-1].tolist():
        found = found * u + sum(w * value for w, value in zip(weights, values, strict=True))
    return found
