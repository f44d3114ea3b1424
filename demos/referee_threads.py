"""What users asked of simulators, on robots built after theirs, and what the referee answers.

Gazebo, Isaac Lab, Genesis and Webots are not asked: their threads are rebuilt in the engine at
hand that has the same fault. An engine that is not installed is left out.

Usage: python demos/referee_threads.py [names of the robots, all if left out]
"""

import math
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import rpctl
from rpctl.engines.engine import Engine, installed_engines
from rpctl.engines.referee import EngineVerdict, Referee

DURATION = 1.6  # s of each motion
RADIUS = 0.1  # m, of wheels
SIDES = (("left", 1.0), ("right", -1.0))
Part = str


def link(name: str, mass: float, inertia: float, shape: str = "", at: str = "0 0 0") -> Part:
    """Return a link of equal moments (kg m²), its shape turned so that a cylinder lies along y."""
    drawn = f'<collision><origin rpy="{0.5 * math.pi} 0 0"/><geometry><{shape}/></geometry>'
    return (
        f'<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/><inertia'
        f' ixx="{inertia}" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="{inertia}"/></inertial>'
        f"{drawn + '</collision>' if shape else ''}</link>"
    )


def joint(name: str, parent: str, xyz: str, axis: str = "0 1 0", driven: bool = False) -> Part:
    """Return the joint of the link NAME_link; one that is not driven has no effort."""
    effort = '<limit effort="50" velocity="20"/>' if driven else ""
    kind = "continuous" if axis else "fixed"
    turns = f'<axis xyz="{axis}"/>' if axis else ""
    motor = (
        f'<transmission name="{name}_motor"><type>T</type><joint name="{name}"/>'
        f'<actuator name="{name}_actuator"/></transmission>'
    )
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}_link"/>'
        f'<origin xyz="{xyz}"/>{turns}{effort}</joint>{motor if driven else ""}'
    )


def wheel(name: str, parent: str, xyz: str, driven: bool = False, radius: float = RADIUS) -> Part:
    """Return a wheel, a cylinder 4 cm wide."""
    drawn = f'cylinder radius="{radius}" length="0.04"'
    return link(f"{name}_link", 1.0, 0.5 * radius**2, drawn) + joint(
        name, parent, xyz, driven=driven
    )


def ball(name: str, xyz: str) -> Part:
    """Return a ball that slides over the ground, fixed to the base."""
    return link(f"{name}_link", 0.2, 1e-4, 'sphere radius="0.05"') + joint(name, "base", xyz, "")


def axle(x: float, half: float, driven: bool) -> list[Part]:
    """Return two wheels across the robot."""
    return [
        wheel(f"{side}_wheel", "base", f"{x} {sign * half} {RADIUS}", driven)
        for side, sign in SIDES
    ]


def caster(name: str, xyz: str) -> list[Part]:
    """Return a swivel whose wheel trails it by 4 cm."""
    fork = link(f"{name}_link", 0.3, 1e-3) + joint(name, "base", xyz, "0 0 1")
    return [fork, wheel(f"{name}_wheel", f"{name}_link", "-0.04 0 -0.05", radius=0.05)]


def base(mass: float, at: str) -> Part:
    """Return the body."""
    return link("base", mass, 0.03 * mass, at=at)


def four_wheels() -> Iterable[Part]:
    """Return four driven wheels, each a cylinder."""
    wheels = [
        wheel(f"{end}_{side}_wheel", "base", f"{x} {0.2 * sign} {RADIUS}", True)
        for end, x in (("front", 0.2), ("rear", -0.2))
        for side, sign in SIDES
    ]
    return [base(20.0, "0 0 0.15"), *wheels]


def tracer() -> Iterable[Part]:
    """Return two driven wheels between swivels before and behind."""
    swivels = [*caster("front", "0.3 0 0.1"), *caster("rear", "-0.3 0 0.1")]
    return [base(30.0, "0 0 0.15"), *axle(0.0, 0.2, True), *swivels]


def rear_steered() -> Iterable[Part]:
    """Return two driven wheels ahead of one that is steered and not driven."""
    fork = link("steer_link", 0.5, 2e-3) + joint("steer", "base", f"-0.6 0 {RADIUS}", "0 0 1", True)
    rear = wheel("rear_wheel", "steer_link", "0 0 0")
    return [base(40.0, "-0.25 0 0.2"), *axle(0.0, 0.25, True), fork, rear]


def forklift() -> Iterable[Part]:
    """Return one wheel that steers and drives, two behind that roll, and four supports."""
    fork = link("steer_link", 0.5, 2e-3) + joint("steer", "base", f"0.8 0 {RADIUS}", "0 0 1", True)
    drive = wheel("drive_wheel", "steer_link", "0 0 0", True)
    feet = [
        ball(f"foot_{x}_{side}", f"{0.3 * x} {0.3 * sign} 0.05")
        for x in (1, 2)
        for side, sign in SIDES
    ]
    return [base(60.0, "0.35 0 0.2"), fork, drive, *axle(0.0, 0.3, False), *feet]


@dataclass(frozen=True)
class Thread:
    """A question, the robot after it, the engine that answers, and what its thread found.

    ``robot`` is one of :data:`ROBOTS`, or of the catalogue.
    """

    cited: str
    asked: str
    robot: str
    engine: str
    cause: str

    def load(self, folder: Path) -> rpctl.Robot:
        """Return the robot, its URDF written to a folder."""
        parts = ROBOTS.get(self.robot)
        if parts is None:
            return rpctl.load(self.robot)
        path = folder / f"{self.robot}.urdf"
        path.write_text(f'<robot name="{self.robot}">{"".join(parts())}</robot>')
        return rpctl.load(path)


ROBOTS = {f.__name__: f for f in (four_wheels, tracer, rear_steered, forklift)}
THREADS = (
    Thread(
        "bullet3 #2851",
        "four wheels do not go where they are driven; the default motors are to be disabled",
        "four_wheels",
        "pybullet",
        "losses",
    ),
    Thread(
        "Genesis #1610",
        "the castors' swivels stand still, and the robot does not follow its wheels",
        "tracer",
        "pybullet",
        "losses",
    ),
    Thread(
        "gz-sim #3324",
        "in Bullet wheels without a motor act as a lock, and the robot goes straight on",
        "rear_steered",
        "pybullet",
        "losses",
    ),
    Thread(
        "IsaacLab #4032",
        "a forklift on passive supports with friction does not turn at small steering angles",
        "forklift",
        "drake",
        "caster",
    ),
    Thread(
        "IsaacLab #1397, bullet3 #2849, webots #6059",
        "a mecanum base read from URDF has plain wheels, and does not move sideways",
        "mecanum",
        "mujoco",
        "wheel",
    ),
)
TURNS = (  # of skid-steer bases, in place
    Thread(
        "husky #120, jackal_simulator #18",
        "a skid-steer base turns in place less than its wheels say, and by fits and starts",
        "four_wheels",
        "mujoco",
        "wheels hop",
    ),
)


def judge(thread: Thread, engine: Engine, folder: Path) -> EngineVerdict:
    """Return the referee's verdict on a thread's robot."""
    return Referee(thread.load(folder), duration=DURATION).judge(engine)


def main(*robots: str) -> None:
    for thread in (*THREADS, *TURNS):
        found, _ = installed_engines([thread.engine])
        if not found or (robots and thread.robot not in robots):
            continue
        with tempfile.TemporaryDirectory() as folder:
            verdict = judge(thread, found[0], Path(folder))
        said = verdict.turn_line if thread in TURNS else verdict.line
        print(f"{thread.cited}: {thread.asked}\n  {said}\n")


if __name__ == "__main__":
    main(*sys.argv[1:])
