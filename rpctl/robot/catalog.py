"""The catalogue: short names for the project's own robots and those of example-robot-data."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata
from pathlib import Path

from rpctl.errors import RpctlError, require_known

EXAMPLE_ROBOT_DATA = "example-robot-data"


@dataclass(frozen=True)
class Entry:
    """A robot of the catalogue.

    Attributes:
        name: The name that stands for the file on a command line.
        file: Path below ``urdf/`` (own robots) or below example-robot-data's ``robots/``.
        summary: One line.
        own: Whether the robot is one of the project's.
        drive: Type of the drive, where nothing in the file tells it.
        lock: Joint name patterns that are frozen unless the user says otherwise.
        leans: Whether it leans on two wheels.
    """

    name: str
    file: str
    summary: str
    own: bool = False
    drive: str | None = None
    lock: tuple[str, ...] = ()
    leans: bool = False

    @property
    def base(self) -> str:
        """``"wheeled"`` or ``"fixed"``."""
        return "fixed" if self.drive == "fixed" else "wheeled"

    @property
    def path(self) -> Path:
        """The URDF file.

        Raises:
            RpctlError: The package that holds it is not installed.
        """
        return (own_robots() if self.own else example_robots()) / self.file


def _own(name: str, summary: str, drive: str | None = None, leans: bool = False) -> Entry:
    return Entry(name, f"{name}.urdf", summary, own=True, drive=drive, leans=leans)


def _arm(name: str, file: str, summary: str) -> Entry:
    return Entry(name, file, summary, drive="fixed")


ENTRIES = (
    _own("paper", "differential drive, revolute and prismatic joint [MS21]"),
    _own("mixed_chain", "off-centre drive, skewed P and R joints"),
    _own("skid_steer", "skid-steer rover, 2R arm that extends", "skid-steer"),
    _own("mecanum", "four mecanum wheels, lift, 4R arm", "mecanum"),
    _own("car", "car with Ackermann steering, 2R arm that extends"),
    _own("tricycle", "stacker whose one front wheel drives and steers, lift"),
    _own("loader", "articulated wheel loader, boom and bucket"),
    _own("bicycle", "held upright: front wheel steers, rear wheel drives, no arm", "bicycle"),
    _own("swerve", "four steered wheels, lift, 2R arm"),
    _own("twin_casters", "four steered casters of two driven wheels, torso lift, head"),
    _own("casters", "differential drive, passive swivel casters, lift, arm that extends"),
    _own("caster_drive", "three powered casters, arm that yaws and lifts"),
    _own("balancer", "self-balancing base on two wheels, arm of one joint", leans=True),
    _own("wheel_legs", "body on two legs, a wheel at the end of each", leans=True),
    _own("whipple", "bicycle that leans, of the benchmark of 2007", leans=True),
    _own("omni", "three omni wheels, 3R arm"),
    _own("arm", "fixed base, arm of 2 prismatic and 3 revolute joints", "fixed"),
    Entry(
        "tiago",
        "tiago_description/robots/tiago.urdf",
        "differential drive, torso lift, 7R arm, fingers locked",
        lock=("hand_*",),
    ),
    Entry(
        "tiago_no_hand",
        "tiago_description/robots/tiago_no_hand.urdf",
        "differential drive, torso lift, 7R arm",
    ),
    Entry(
        "tiago_dual",
        "tiago_description/robots/tiago_dual.urdf",
        "differential drive, torso lift, two 7R arms, fingers locked",
        lock=("hand_*", "suspension_*"),
    ),
    Entry(
        "tiago_pro",
        "tiago_pro_description/robots/tiago_pro.urdf",
        "four mecanum wheels, torso lift, two 7R arms, grippers locked",
        drive="mecanum",
        lock=("gripper_*",),
    ),
    _arm(
        "pr2",
        "pr2_description/urdf/pr2.urdf",
        "torso lift, two 7R arms; its file fixes the casters",
    ),
    _arm("panda", "panda_description/urdf/panda.urdf", "7R arm with gripper"),
    _arm("ur3", "ur_description/urdf/ur3_robot.urdf", "6R arm"),
    _arm("ur5", "ur_description/urdf/ur5_robot.urdf", "6R arm"),
    _arm("ur10", "ur_description/urdf/ur10_robot.urdf", "6R arm"),
    _arm("xarm7", "xarm_description/urdf/xarm7.urdf", "7R arm"),
    _arm("z1", "z1_description/urdf/z1.urdf", "6R arm"),
    _arm("kinova", "kinova_description/robots/kinova.urdf", "6R arm with fingers"),
    _arm("so100", "so_arm_description/urdf/so100.urdf", "5R arm with gripper"),
    _arm("so101", "so_arm_description/urdf/so101.urdf", "5R arm with gripper"),
    _arm("baxter", "baxter_description/urdf/baxter.urdf", "two 7R arms"),
    _arm("allegro", "allegro_hand_description/urdf/allegro_right_hand.urdf", "16R hand"),
    _arm("asr_twodof", "asr_twodof_description/urdf/TwoDofs.urdf", "2R arm"),
    _arm("finger_edu", "finger_edu_description/robots/finger_edu.urdf", "3R finger"),
    _arm(
        "double_pendulum",
        "double_pendulum_description/urdf/double_pendulum.urdf",
        "2R pendulum",
    ),
)


def names() -> tuple[str, ...]:
    """Return the names of the catalogue, in its order."""
    return tuple(entry.name for entry in ENTRIES)


def find(name: str) -> Entry:
    """Return the entry of a name.

    Raises:
        UnknownNameError: No robot of the catalogue has the name; the nearest are suggested.
    """
    require_known("robot", [name], names())
    return next(entry for entry in ENTRIES if entry.name == name)


@lru_cache(maxsize=1)
def own_robots() -> Path:
    """Return the folder of the project's own URDFs, in an installed package or a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "urdf"
    return installed if installed.is_dir() else package.parent / "urdf"


@lru_cache(maxsize=1)
def example_robots() -> Path:
    """Return the folder of example-robot-data's robots.

    Raises:
        RpctlError: The package is not installed.
    """
    marker = f"share/{EXAMPLE_ROBOT_DATA}/robots/"
    with suppress(metadata.PackageNotFoundError):
        for file in metadata.files(EXAMPLE_ROBOT_DATA) or []:
            head, found, _ = file.as_posix().partition(marker)
            if found:
                package = metadata.distribution(EXAMPLE_ROBOT_DATA)
                return Path(str(package.locate_file(head + marker)))
    raise RpctlError(f"{EXAMPLE_ROBOT_DATA} is not installed; pip install {EXAMPLE_ROBOT_DATA}")
