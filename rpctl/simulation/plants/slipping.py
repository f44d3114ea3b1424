"""A robot whose wheels slip: the whole tree on tyres, without the rolling constraint.

The body stays upright; all wheels, swivels and joints of the arm move by their own dynamics, under
the forces of tyres at the places where the file puts the wheels. As the slip stiffness grows, a
gentle motion tends to that of the reduced model, the difference to first order in 1/stiffness,
wherever the wheels can all roll at once. They cannot where the reduced model lets some slide: a
skid-steer drive, a wheel off the axle, front wheels that a mimic joint turns by equal angles. These
scrub here at any stiffness, and take the efforts that it needs. Supports that are no wheels slide
without friction.

[P12] and [J85] are those of :mod:`rpctl.simulation.plants.tyres`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts, find_contacts
from rpctl.dynamics.motion import Step
from rpctl.dynamics.projection import Projector
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.stops import Stops
from rpctl.robot.coordinates import level_pose
from rpctl.robot.model import Robot
from rpctl.simulation.plants.free_tree import FreeTree
from rpctl.simulation.plants.protocol import Ground
from rpctl.simulation.plants.rolling import in_steps
from rpctl.simulation.plants.settings import Slipping, Wrench
from rpctl.simulation.plants.slip_step import SlipStepper
from rpctl.simulation.plants.tyres import TyreLaw


class SlippingMotion:
    """A robot that moves on tyres; a :class:`~rpctl.simulation.plants.protocol.Motion`.

    Args:
        robot: The robot.
        settings: Its tyres.
        friction: Coefficient between wheels and ground.
        q: Where it stands at the start (nq,), at rest.
        longest: Longest step, s.
    """

    def __init__(
        self, robot: Robot, settings: Slipping, friction: float, q: Array, longest: float
    ) -> None:
        dynamics = ReducedDynamics(robot)
        contacts = find_contacts(dynamics, friction)
        law = TyreLaw(
            friction,
            settings.slip_stiffness,
            settings.creep_speed,
            settings.rolling_resistance,
        )
        projector = Projector(robot, dynamics.rolling)
        tree = FreeTree(dynamics, contacts)
        self.robot, self._longest, self._t = robot, longest, 0.0
        moved = {robot.velocity_index(name): name for name in robot.moving_joint_names}
        stops = Stops(robot, [moved.get(i, "") for i in tree.free.tolist()])
        self._stepper = SlipStepper(tree, law, projector.columns, stops)
        self._selection = projector.selection
        self._along = tree.contact_velocities.along
        self._leading = leading_wheels(robot)
        self._assumed = _assumptions(robot, contacts)
        self._tipped: float | None = None
        self._held = 0
        self.state = self._stepper.start(np.array(q), np.zeros(robot.nv))

    @property
    def q(self) -> Array:
        """Configuration (nq,)."""
        return self.state.at.q

    @property
    def nu(self) -> Array:
        """Quasi-velocities (dof,): base speeds of the body as it moves, rates of the joints.

        With steered wheels only, the first speed is that of the first swivel's contact along its
        wheels, whether they roll or slip.
        """
        nu = self._selection.dot(self.state.v)
        if self._leading:
            nu[0] += self.state.contact_velocity[0, list(self._leading)].mean()
        return np.asarray(nu)

    @property
    def pose(self) -> Array:
        """Pose of the root link (7,): x, y, z (m), quaternion x, y, z, w; world."""
        return level_pose(self.q, -self.robot.drive.ground)

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed or mended, in sentences."""
        notes = list(self._assumed)
        if self._tipped is not None:
            notes.append(
                f"from {self._tipped:.4g} s on there were moments at which no loads that only push "
                "balance the robot: it would tip, and is held upright; contacts that would lift "
                "bear nothing"
            )
        if self._held:
            notes.append(
                f"in {self._held} steps loads and forces of the tyres found no common solution; "
                "the loads are those of the accelerations just before"
            )
        return tuple(notes)

    def ground(self) -> Ground:
        """Return the load of each contact and the slip of each wheel."""
        (slip, left, _), (cos, sin) = self.state.contact_velocity, self._along
        return Ground(
            self.state.load, np.column_stack([cos * slip - sin * left, sin * slip + cos * left])
        )

    def advance(self, tau: Array, dt: float, wrenches: Sequence[Wrench] = ()) -> Step:
        """Advance it under constant efforts, in equal steps.

        Args:
            tau: Actuator efforts (n_act,), N·m or N.
            dt: For how long, s.
            wrenches: What pushes it besides; their times do not count.

        Raises:
            DivergedError: The state left the finite numbers.
        """

        def one(q: Array, y: Array, stride: float) -> Step:
            with np.errstate(over="ignore", invalid="ignore"):  # what diverges is told
                self.state, *balance = self._stepper.step(self.state, tau, stride, wrenches)
            self._t += stride
            self._held += self.state.held
            if self.state.tips and self._tipped is None:
                self._tipped = self._t
            return Step(self.q, self.state.y, *balance)

        done = in_steps(one, self.q, self.state.y, dt, self._longest)
        return done._replace(nu=self.nu)


def leading_wheels(robot: Robot) -> tuple[int, ...]:
    """Return the wheels whose rolling is the first quasi-velocity, where no axle fixes P."""
    drive = robot.drive
    if drive.has_axle or not drive.steered:
        return ()
    return drive.carried(drive.steered[0])


def _assumptions(robot: Robot, contacts: Contacts | None) -> tuple[str, ...]:
    """Return what the loads of the tyres take for granted, in sentences."""
    if contacts is None:
        return ("the base is fixed: no wheel slips",)
    notes: list[str] = []
    if contacts.supports.unknown:
        listed = ", ".join(contacts.supports.unknown)
        notes.append(
            f"the tyres bear the whole load: {listed} touch the ground, but are drawn as meshes "
            "only, so their places are not known"
        )
    elif not contacts.balanced:
        notes.append(
            f"the tyres bear the load as if balance were kept: {', '.join(contacts.names)} stand "
            "on one line"
        )
    elif not contacts.determinate:
        notes.append(
            f"{len(contacts.names)} contacts share the load, more than statics can tell apart: the "
            "tyres bear what equally stiff contacts would"
        )
    if robot.drive.followers:
        listed = ", ".join(swivel.joint for swivel in robot.drive.followers)
        notes.append(
            f"{listed} turn exactly as the other wheels' steering asks, as if rods tied them"
        )
    return tuple(notes)
