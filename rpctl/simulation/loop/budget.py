"""What a run will cost, known before it begins; beyond the caps it is refused."""

from __future__ import annotations

from dataclasses import dataclass

from rpctl.errors import RpctlError
from rpctl.files.caps import cap, how_to_raise
from rpctl.robot.model import Robot
from rpctl.simulation.config import RunSettings, whole_periods
from rpctl.simulation.plants.rolling import substeps

# The least that a step of each kind takes, s, on a processor of today: laws and reference, the
# four evaluations of a plant step, and what a logged sample is derived from.
PERIOD_S, PLANT_STEP_S, ROW_S = 1e-4, 3e-5, 5e-5
ROW_BYTES = 100  # of a logged sample: what is of the base and of time alone
TIME_UNITS = ((86_400.0, "days"), (3600.0, "hours"), (60.0, "minutes"), (0.0, "s"))
BYTE_UNITS = ((1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB"), (0.0, "bytes"))


@dataclass(frozen=True)
class Budget:
    """What a run will cost.

    Attributes:
        periods: Control periods.
        plant_steps: Steps of the plant.
        rows: Logged samples.
        log_bytes: That they take, about.
        seconds: Of computing, at least: laws that solve programs take more.
    """

    periods: int
    plant_steps: int
    rows: int
    log_bytes: int
    seconds: float

    def __str__(self) -> str:
        """Return it in words."""
        return (
            f"{self.periods:,} control periods, {in_bytes(self.log_bytes)} of log, "
            f"{in_time(self.seconds)} of computing or more"
        )

    @property
    def brief(self) -> str:
        """The work and the log, in the few characters that a progress bar leaves."""
        return f"{self.periods:,} periods, {in_bytes(self.log_bytes)}"

    def require_within_caps(self) -> None:
        """Refuse a run that would take too long or log too much.

        Raises:
            RpctlError: What it would cost, and how to raise the cap.
        """
        less = "simulate for less long, or lengthen control_period and plant_step"
        if self.seconds > cap("MAX_RUN_SECONDS"):
            raise RpctlError(
                f"the run would take too long: {self}; {less}; {how_to_raise('MAX_RUN_SECONDS')}"
            )
        if self.log_bytes > cap("MAX_RUN_BYTES"):
            raise RpctlError(
                f"the run would log too much: {self}; log fewer samples (log_every), or {less}; "
                f"{how_to_raise('MAX_RUN_BYTES')}"
            )


def find_budget(robot: Robot, settings: RunSettings, duration: float) -> Budget:
    """Return what a run will cost.

    Args:
        robot: The robot.
        settings: Sample times.
        duration: s.
    """
    periods = whole_periods(duration, settings.control_period)
    plant_steps = periods * substeps(settings.control_period, settings.plant_step)
    rows = periods // settings.log_step(periods) + 1
    row = ROW_BYTES + 8 * (2 * robot.model.nq + 2 * robot.nv + 3 * robot.dof)
    row += 8 * (2 * len(robot.actuators) + 3 * len(robot.joints) + 6 * len(robot.drive.wheels))
    seconds = PERIOD_S * periods + PLANT_STEP_S * plant_steps + ROW_S * rows
    return Budget(periods, plant_steps, rows, row * rows, seconds)


def in_time(seconds: float) -> str:
    """Return a time in the unit that suits it: ``"3 minutes"``."""
    unit, name = next((unit, name) for unit, name in TIME_UNITS if seconds >= 2.0 * unit)
    return f"{seconds / (unit or 1.0):,.3g} {name}"


def in_bytes(size: float) -> str:
    """Return an amount of memory in the unit that suits it: ``"17 MB"``."""
    scale, name = next((scale, name) for scale, name in BYTE_UNITS if size >= scale)
    return f"{size / (scale or 1.0):,.3g} {name}"
