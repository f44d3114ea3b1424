"""A reference from a plain function of time; its derivatives are taken here."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.polynomial.polynomial import polyder, polyval

from rpctl.arrays import Array
from rpctl.errors import RpctlError, require_positive
from rpctl.reference.motion import ReferenceState
from rpctl.reference.paths import Numbers, entries, functions, split_rows, vector

STEP_S = 0.01  # s; error of the first derivative ~ STEP⁶, rounding in the second ~ 1e-16 / STEP²
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

    The derivatives are those of the polynomial of sixth degree through seven values of the
    function, 10 ms apart; between t = 0 and the end it is called nowhere else. They are good to
    about 1e-9 where the function is smooth, and mean nothing where it jumps or bends sharply.

    Args:
        function: Of the time t (s), returns the pose of P and the arm's positions (3 + n_joints,):
            x and y (m), heading (rad; it may jump by full turns), joints (rad or m).
        joints: Positions (n_joints,) where the arm stays; the function returns no joints then.
        along_path: Whether the heading is the direction of motion; the function leaves it out and
            returns x and y, then the joints.
        duration: s; afterwards the reference stands still where it is. None: it has no end.

    Raises:
        RpctlError: The duration is no positive number of at least 60 ms.
    """
    return FunctionReference(function, joints, along_path, duration)


class FunctionReference:
    """A :data:`Reference` that a function describes; see :func:`as_reference` for the arguments."""

    def __init__(
        self,
        function: Callable[[float], Sequence[float] | Array],
        joints: Sequence[float] | Array | None,
        along_path: bool,
        duration: float | None,
    ) -> None:
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
        self._joints = None if joints is None else np.array(joints, dtype=float)
        self._along_path = along_path
        self.__name__ = str(getattr(function, "__name__", type(function).__name__))

    def __call__(self, t: Numbers) -> ReferenceState:
        """Return the reference at t (s), or at times (K,), a row each.

        Raises:
            RpctlError: The function returns something else than it has to.
        """
        resting = t > self._end
        values = self._derivatives(np.clip(t, 0.0, self._end))
        heading = self._heading(values, t) if self._along_path else entries(values[..., :3, 2])
        moving = 1.0 - resting
        values[..., 1:, :] *= np.asarray(moving)[..., None, None]
        place = _place(values, (heading[0], *(moving * rate for rate in heading[1:])))
        if self._joints is None:
            found = values[..., :3, 2 if self._along_path else 3 :]
        else:
            found = np.zeros((*np.shape(t), 3, len(self._joints)))
            found[..., 0, :] = self._joints
        positions, rates, accelerations = split_rows(found)
        return ReferenceState(*place, positions, rates, accelerations)

    def _derivatives(self, t: Numbers) -> Array:
        """Return what the function describes and its first three derivatives (..., 4, n) at t."""
        middle = np.clip(t, REACH * STEP_S, self._end - REACH * STEP_S)
        times = np.asarray(middle)[..., None] + STEP_S * NODES
        values = [self._sample(at) for at in times.ravel().tolist()]
        if len({len(value) for value in values}) > 1:
            raise RpctlError(
                f"the reference {self.__name__} returns now more and now fewer numbers; return as "
                "many at all times"
            )
        samples = np.array(values).reshape(*times.shape, -1)
        if not self._along_path:
            samples[..., 2] = np.unwrap(samples[..., 2])
        coefficients = np.moveaxis(TO_COEFFICIENTS @ samples, -2, 0)
        u = np.asarray((t - middle) / STEP_S)[..., None]
        rows = [
            polyval(u, polyder(coefficients, order), tensor=False) / STEP_S**order
            for order in range(4)
        ]
        return np.stack(rows, axis=-2)

    def _sample(self, t: float) -> Array:
        """Return the function's values at one time, checked."""
        least = 2 if self._along_path else 3
        what = "x, y" if self._along_path else "x, y, heading"
        what += ", then the arm's joints" if self._joints is None else ""
        value = self._function(t)
        try:
            numbers = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            numbers = np.empty(0)
        if numbers.ndim != 1 or len(numbers) < least or not np.isfinite(numbers).all():
            raise RpctlError(
                f"the reference {self.__name__} returns {value!r} at t = {t:.4g} s; "
                f"return finite numbers: {what}"
            )
        return numbers

    def _heading(self, values: Array, t: Numbers) -> tuple[Any, Any, Any]:
        """Return the direction of motion and its first two derivatives, rad."""
        (x1, y1), (x2, y2), (x3, y3) = (entries(values[..., k, :2]) for k in (1, 2, 3))
        square = x1 * x1 + y1 * y1
        stands = np.atleast_1d(square < MIN_TANGENT_SPEED**2)
        if stands.any():
            first = np.atleast_1d(t)[int(stands.argmax())]
            raise RpctlError(
                f"the reference {self.__name__} stands still at t = {first:.4g} s, so it has no "
                "direction of motion; return a heading, without along_path"
            )
        cross = x1 * y2 - y1 * x2
        rate = cross / square
        change = (x1 * y3 - y1 * x3 - 2.0 * rate * (x1 * x2 + y1 * y2)) / square
        return functions(x1).atan2(y1, x1), rate, change


def _place(values: Array, heading: tuple[Any, Any, Any]) -> tuple[Array, Array, Array]:
    """Return the pose of P (..., 3), its twist and the twist's derivative in the pose's axes.

    Args:
        values: x and y, and their derivatives (..., 4, n).
        heading: The heading and its first two derivatives, rad.
    """
    (x, y), (x1, y1), (x2, y2) = (entries(values[..., k, :2]) for k in range(3))
    angle, rate, change = heading
    cos, sin = functions(angle).cos(angle), functions(angle).sin(angle)
    forward, left = cos * x1 + sin * y1, cos * y1 - sin * x1
    twist_dot = cos * x2 + sin * y2 + rate * left, cos * y2 - sin * x2 - rate * forward, change
    return vector(x, (x, y, angle)), vector(x, (forward, left, rate)), vector(x, twist_dot)
