"""A kinematic law of one's own, in ten lines, beside rpctl's on a figure-eight.

A law is anything that can be called so; one that is known by the twist it asks of the base is a
``BaseLaw``. This one steers at a point ahead of P by feedback linearisation, and takes the twist's
derivative from the reference alone.
"""

from dataclasses import dataclass

import numpy as np

import rpctl


@dataclass(frozen=True)
class PointAhead(rpctl.BaseLaw):
    """Leads the point ``ahead`` m in front of P onto the one in front of the reference."""

    horizon: float = 0.65
    ahead: float = 0.3

    def unicycle(self, tracking: rpctl.Tracking) -> rpctl.Twist:
        """Return the twist to ask of a base that cannot move sideways."""
        (v_r, _, omega_r), x = tracking.state.twist, tracking.e
        cos, sin = np.cos(x[2]), np.sin(x[2])
        v_d = v_r * cos - omega_r * self.ahead * sin
        v_d += (x[0] + self.ahead * (cos - 1.0)) / self.horizon
        omega_d = v_r * sin / self.ahead + omega_r * cos
        omega_d += (x[1] / self.ahead + sin) / self.horizon
        return rpctl.Twist(np.array([v_d, 0.0, omega_d]), tracking.state.twist_dot)


def main() -> None:
    robot = rpctl.load("paper")
    for law in (PointAhead(), rpctl.UnifiedKinematic()):
        run = rpctl.track(
            robot, "eight", duration=20.0, initial_error=(0.1, -0.1, 0.1), kinematic=law
        )
        rms = 1e3 * rpctl.summarize(run).rms_base_error
        print(f"{type(law).__name__:17} base {rms:.1f} mm rms off its reference")


if __name__ == "__main__":
    main()
