"""A study file to begin with: it fits the robot, works as it is, and says what else there is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpctl.errors import RpctlError
from rpctl.robot.model import Robot
from rpctl.simulation.config import Config
from rpctl.study.distributions import distribution_of
from rpctl.study.merits import MERITS, merits_for
from rpctl.study.scatter import require_path, scattered_paths, with_values

DESIGN_LINES = """\
# monte-carlo draws at random (a larger count adds runs), latin-hypercube spreads more evenly, grid
# takes all combinations; sobol and morris tell what matters: shares of variance, mean effects.
"""


class Example(NamedTuple):
    """A line of the table ``[scatter]``."""

    path: str
    kind: str
    numbers: list[float]
    comment: str

    @property
    def line(self) -> str:
        """What it says, but for the comment."""
        return f'"{self.path}" = {{ {self.kind} = {self.numbers} }}'

    def fits(self, robot: Robot, config: Config) -> bool:
        """Return whether the robot has such a thing."""
        tried = distribution_of({self.kind: self.numbers}, self.path).quantile(np.array([0.25]))
        try:
            require_path(config, self.path)
            with_values(config, (self.path,), tried).plant.simulated_robot(robot)
        except RpctlError:
            return False
        return True


def study_template(robot: Robot) -> str:
    """Return a study file for a robot, with comments."""
    config = Config()
    shown = [each for each in _examples(robot) if each.fits(robot, config)]
    width = max(len(each.line) for each in shown)
    scatter = "".join(f"{each.line:{width}}  # {each.comment}\n" for each in shown)
    reference = "eight" if robot.drive.base_speeds else "ee-square"
    merits = "".join(
        f"#   {name:26}{MERITS[name].unit:9}{MERITS[name].what}\n" for name in merits_for(robot)
    )
    paths = "".join(f"#   {path}\n" for path in scattered_paths(config))
    return f"""\
# A study of {robot.name}: rpctl study ROBOT THIS_FILE --out DIR
# Tables of a configuration ([run], [kinematic], [dynamic], [plant], [limits]) hold for all runs.

[study]
{DESIGN_LINES}design = "monte-carlo"
count = 100              # runs; a design that needs a certain number takes the largest within
seed = 0                 # of all that is drawn
duration = 5.0           # of each run, s
samples = 100            # points of the curves over time that are kept
merit = "rms_base_error" # that runs are compared by
worst = 3                # so many of the worst runs are written, to be replayed by rpctl track
tolerance = 0.05         # m: how far from its reference a run that succeeds may end

[run]
reference = "{reference}"
control_period = 0.002   # s
plant_step = 0.002       # s

[kinematic]
law = "unified"

[dynamic]
law = "integral"

# What differs from run to run: a number, or uniform = [low, high], log-uniform = [low, high],
# normal = [mean, standard deviation], normal = [mean, standard deviation, low, high],
# choice = [value, ...].
[scatter]
{scatter}
# A run succeeds if it exceeds none of these; without this table it succeeds if it ends within the
# tolerance and breaks no limit.
# [success]
# rms_base_error = 0.1

# Settings to be found by --optimize, within their ranges, for all the scatter at once.
[optimize]
merit = "rms_base_error"
statistic = "quantile"   # or "mean", or "worst"
level = 0.95             # of the quantile
failure_weight = 1.0     # what the share of runs that fail costs, in the merit's unit
evaluations = 64         # sets of settings that are tried
runs = 16                # of each
validation = 100         # fresh runs with what was found, and with the settings above

[optimize.parameters]
"kinematic.horizon" = [0.2, 1.5]
"dynamic.gain" = {{ log-uniform = [1.0, 50.0] }}

# Merits of this robot, all smaller if better:
{merits}#
# What can be scattered (PATTERN: names of joints or links, as "arm_*"):
{paths}"""


def _examples(robot: Robot) -> list[Example]:
    """Return lines that a robot may have; those of settings that there are not are left out."""
    wheels = [wheel.joint for wheel in robot.drive.wheels if wheel.driven]
    friction = [
        Example(
            f"plant.joint_friction.{wheel}", "uniform", [0.0, 0.2], "dry, besides the file's, N m"
        )
        for wheel in wheels[:1]
    ]
    start = [
        Example("run.initial_error.y", "normal", [0.0, 0.05], "at the start, m"),
        Example("run.initial_error.theta", "normal", [0.0, 0.1], "rad"),
    ]
    return [
        Example("plant.masses.*", "uniform", [0.9, 1.1], "times those of the file"),
        Example("plant.track", "uniform", [0.98, 1.02], "likewise"),
        *friction,
        Example("plant.delay", "uniform", [0.0, 0.01], "from a sample to its efforts, s"),
        Example("plant.noise.position", "fixed", [0.001], "of what is measured, m; in all runs"),
        *(start if robot.drive.base_speeds else ()),
    ]
