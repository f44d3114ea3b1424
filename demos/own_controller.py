"""A kinematic law of one's own, in ten lines, beside rpctl's on a figure-eight.

A law is anything that can be called so; one that is known by the twist it asks of the base is a
``BaseLaw``: a formula, of which rpctl makes the rate that the dynamic law needs, machine code, and
C. Its settings are those of a configuration or a study (``"kinematic.ahead" = [0.1, 0.5]``):

    rpctl track tiago --kinematic demos/own_controller.py:PointAhead
    rpctl derive tiago --law demos/own_controller.py:PointAhead --format c

This one steers at a point ahead of P by feedback linearisation.
"""

from dataclasses import dataclass
from typing import Annotated, Any

import rpctl
from rpctl import math
from rpctl.files.records import POSITIVE


@dataclass(frozen=True)
class PointAhead(rpctl.BaseLaw):
    """Leads the point ``ahead`` m in front of P onto the one in front of the reference."""

    ahead: Annotated[float, POSITIVE, rpctl.Setting("m", "Look-ahead", "Of P.")] = 0.3

    def unicycle(self, at: rpctl.Tracking) -> tuple[Any, Any]:
        """Return the speed and the turning rate to ask of a base that cannot move sideways."""
        (v_r, _, omega_r), (x1, x2, x3) = at.twist, at.e
        cos, sin = math.cos(x3), math.sin(x3)
        v_d = v_r * cos - omega_r * self.ahead * sin
        v_d += (x1 + self.ahead * (cos - 1.0)) / self.horizon
        omega_d = v_r * sin / self.ahead + omega_r * cos
        omega_d += (x2 / self.ahead + sin) / self.horizon
        return v_d, omega_d


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
