"""``ContactSettings``: how a robot meets the ground in MuJoCo, and how finely that is computed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from rpctl.errors import RpctlError, require_positive, require_within

WHEEL_SHAPES = ("cylinder", "crowned")
CONES = ("elliptic", "pyramidal")
MIN_CONSTANT_IN_STEPS = 20.0  # time constant over timestep: harder contacts chatter as they slip


@dataclass(frozen=True)
class ContactSettings:
    """How a robot meets the ground in MuJoCo; table [plant.contact].

    Attributes:
        wheel_width: Of all wheels, m; None: each as its file draws it. A wheel that turns on a
            line of this length scrubs: its moment is about μ N width/4.
        wheel_shape: ``"cylinder"``, or ``"crowned"``: an ellipsoid, which touches at one point and
            does not scrub.
        caster_friction: Coefficient of supports that nothing lets roll, balls and skids; casters
            that swivel and roll by joints of the file have the ground's friction. 0: they slide.
        cone: ``"elliptic"``, Coulomb's, or ``"pyramidal"``, which creeps, and holds less askew.
        timestep: Longest step, s; each stretch is divided into equal steps no longer.
        time_constant: Of contacts, s; at least 20 timesteps. Shorter is harder: a robot sinks by
            about a quarter of g times its square.
        losses: Whether the joints lose what the robot's do (damping and dry friction).
        heights: A file of heights of the ground (.png, .csv or .npy); empty: a plane at 0.
        extent: Length along x and y of the ground that ``heights`` shows, m; its middle is the
            origin.
        relief: Height of white in a .png, m; multiplies the heights, in m, of the others.
        props: Whether four balls that slide without friction hold the robot up, around P, half a
            track off: for a robot whose file draws too few contacts to stand on.
        body: Whether all that the file draws for collisions meets the ground, not only wheels and
            supports.
    """

    wheel_width: float | None = None
    wheel_shape: str = "cylinder"
    caster_friction: float = 0.0
    cone: str = "elliptic"
    timestep: float = 1e-3
    time_constant: float = 2e-2
    losses: bool = True
    heights: str = ""
    extent: tuple[float, float] = (20.0, 20.0)
    relief: float = 1.0
    props: bool = False
    body: bool = False

    def __post_init__(self) -> None:
        """Refuse what MuJoCo cannot take."""
        if self.wheel_width is not None:
            require_positive("wheel_width", self.wheel_width)
        for name in ("timestep", "time_constant", "relief"):
            require_positive(name, getattr(self, name))
        if self.wheel_shape not in WHEEL_SHAPES:
            raise RpctlError(
                f'wheel_shape is "{self.wheel_shape}"; give {" or ".join(WHEEL_SHAPES)}'
            )
        if self.cone not in CONES:
            raise RpctlError(f'cone is "{self.cone}"; give {" or ".join(CONES)}')
        if not (math.isfinite(self.caster_friction) and self.caster_friction >= 0.0):
            raise RpctlError(f"caster_friction is {self.caster_friction:g}; give 0 or more")
        require_within("caster_friction", [self.caster_friction])
        if self.time_constant < MIN_CONSTANT_IN_STEPS * self.timestep * (1.0 - 1e-9):
            raise RpctlError(
                f"time_constant is {self.time_constant:g} s, less than 20 timesteps of "
                f"{self.timestep:g} s; lengthen it, or shorten timestep"
            )
        if len(self.extent) != 2:
            raise RpctlError(f"extent is {self.extent}; give the lengths along x and y in m")
        for length in self.extent:
            require_positive("extent", length)
