"""A robot's contacts with the ground: wheels or their rollers, supports, stiffness of contacts.

Mecanum and omni wheels carry rollers, because MuJoCo's friction has no direction that turns with a
wheel. A roller is an ellipsoid whose profile has the curvature of the wheel's rim along the roller,
which lies at an angle γ to the axle: half its length is √(b (r − b cos²γ))/sin γ, b its radius, so
that the rim is round to fourth order. Rollers overlap, because they do not collide.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.description.records import Shape, rotation
from rpctl.drive.drive import Wheel
from rpctl.dynamics.stance import find_supports
from rpctl.engines.mujoco.bodies import body_name, is_physical, place_in_body
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.equivalence.contact.leaning_body import half_width
from rpctl.equivalence.contact.model import about, geom_size, support_shapes, tyre
from rpctl.equivalence.contact.mujoco_body import (
    add_shape,
    mujoco_library,
    vertical_inverse_masses,
)
from rpctl.equivalence.mujoco_engine import Inertial, combined
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot

GROUND = "ground"  # name of the ground's geom
SHARE = 0.2  # impedance along the normal: share of a contact's acceleration that it determines
GRIP = 100.0  # stiffness of friction over that along the normal (``impratio``)
PYRAMID_IMPEDANCE = [0.9, 0.95, 1e-3, 0.5, 2.0]
PROP = 0.02  # m, radius of a prop
MIN_REACH = 0.1  # m: a prop's distance ahead of P and to its side, at least
ALIKE = 3.0  # ratio of inverse masses up to which MuJoCo's value is kept: the robot stands level
ROLLERS = 12  # per wheel: its rim is round to 1 % of its radius
ROLLER_THICKNESS = 0.25  # radius of a roller, of the wheel's
ROLLER_MASS = 5e-3  # mass of a roller over the wheel's; a rolling model has massless rollers
ROLLER_STEPS = 3.0  # timesteps: time constant of a roller's contact; a soft one takes energy as
ROLLER_IMPEDANCE = (0.9, 0.95, 1e-3, 0.5, 2.0)  # each roller presses in and leaves
ROLLER_NOTE = (
    f"each mecanum or omni wheel has {ROLLERS} barrel rollers at the drive's angle; each roller "
    "takes 1/200 of the wheel's mass"
)


def has_rollers(robot: Robot) -> bool:
    """Return whether a robot's wheels carry rollers."""
    return robot.drive.type in ("mecanum", "omni")


class GroundContacts:
    """Adds a robot's contacts with the ground to its spec.

    Attributes:
        owners: Name of the contact of each geom of a wheel or support, by the geom's name.
        notes: Sentences on what was assumed.
    """

    def __init__(self, spec: Any, robot: Robot, settings: ContactSettings, friction: float) -> None:
        self._spec, self._robot, self._settings = spec, robot, settings
        self._friction, self._supports = friction, find_supports(robot)
        self.owners: dict[str, str] = {}
        self.notes: list[str] = []

    def add_all(self) -> None:
        """Add wheels, supports, and the further contacts of the settings."""
        rolling = has_rollers(self._robot)
        for wheel in self._robot.drive.wheels:
            self._add_rollers(wheel) if rolling else self._add_wheel(wheel)
        self.notes = [ROLLER_NOTE] if rolling else [*dict.fromkeys(self.notes)]
        self._add_supports()
        self._add_drawn_casters()
        if self._settings.props:
            self._add_props()
        if self._settings.body:
            self._add_body()

    def _add(
        self, body: Any, name: str, kind: str, size: list[float], pose: Array, friction: float
    ) -> Any:
        """Add a geom that touches the ground to an ``MjsBody``, and return the contact pair.

        ``kind`` and ``size`` are MuJoCo's; without friction the geom slides.
        """
        geom = add_shape(body, name, kind, size, pose)
        geom.mass = geom.contype = geom.conaffinity = 0
        pair = self._spec.add_pair(name=name, geomname1=GROUND, geomname2=name)
        pair.condim = 3 if friction > 0.0 else 1
        pair.friction = [friction, friction, 0.0, 0.0, 0.0]
        self._soften(pair)
        return pair

    def _soften(self, pair: Any) -> None:
        """Set the stiffness of a contact, along its normal and along the ground.

        MuJoCo's friction is relaxed: a contact that slides at a speed v is lifted by μ b v/k, where
        b is the rate at which friction ends slip and k the stiffness under the load. Here b is set
        for the tangential directions only and the impedance along the normal is low, so that the
        lift is smaller than the penetration; with MuJoCo's defaults a cylinder that scrubs leaves
        the ground and chatters. ``impratio`` keeps friction stiff. A pyramid has one set of numbers
        for all directions and keeps MuJoCo's.
        """
        constant = self._settings.time_constant
        if self._settings.cone == "pyramidal":
            pair.solref, pair.solimp = [constant, 1.0], PYRAMID_IMPEDANCE
            return
        rate = 1.0 / constant
        pair.solref = [-(rate**2) / SHARE, -2.0 * rate / SHARE]
        pair.solreffriction = [-1.0, -2.0 * rate]
        pair.solimp = [SHARE, SHARE, 1e-3, 0.5, 2.0]

    def _on_link(self, link: str, name: str, shape: Shape, friction: float) -> None:
        """Let a shape of a link touch the ground."""
        head, pose = place_in_body(self._robot, link)
        body = self._spec.body(body_name(head))
        self._add(body, name, shape.kind, geom_size(shape), pose @ shape.origin, friction)

    def _wheel_body(self, wheel: Wheel) -> Any:
        return self._spec.body(body_name(self._robot.description.joint[wheel.joint].child))

    def _tread(self, wheel: Wheel) -> tuple[str, list[float]]:
        """Return the shape of a wheel's tread, and its size as MuJoCo counts it."""
        settings, half_width = self._settings, 0.0
        if settings.wheel_width is not None:
            half_width = 0.5 * settings.wheel_width
        else:
            tread = tyre(self._robot, wheel)
            half_width = tread.half_width
            self.notes += [tread.note] if tread.note else []
        if settings.wheel_shape == "crowned":
            return "ellipsoid", [wheel.radius, wheel.radius, half_width]
        return "cylinder", [wheel.radius, half_width, 0.0]

    def _add_wheel(self, wheel: Wheel) -> None:
        kind, size = self._tread(wheel)
        axis = np.array(wheel.axis)
        pose = about(axis)
        pose[:3, 3] = wheel.offset * axis
        # A ball slides, although its joint in the file turns about one axis.
        ball = wheel.slides and not wheel.driven and "sphere" in wheel.source
        friction = self._settings.caster_friction if ball else self._friction
        self._add(self._wheel_body(wheel), wheel.joint, kind, size, pose, friction)
        self.owners[wheel.joint] = wheel.joint

    def _add_rollers(self, wheel: Wheel) -> None:
        robot, body = self._robot, self._wheel_body(wheel)
        R = robot.tree.pose(robot.description.joint[wheel.joint].child)[:3, :3]
        axle, along = np.array(wheel.axis), R.T @ np.array([*wheel.direction, 0.0])
        down = R.T @ np.array([0.0, 0.0, -1.0])
        b, cos = ROLLER_THICKNESS * wheel.radius, float(along @ axle)
        size = [b, b, math.sqrt(b * (wheel.radius - b * cos**2) / (1.0 - cos**2))]
        carried = robot.model.inertias[robot.model.getJointId(wheel.joint)]
        mass = ROLLER_MASS * float(carried.mass)
        inertia = Inertial(mass, np.zeros(3), 0.4 * mass * b * b * np.eye(3))
        places = []
        for k in range(ROLLERS):
            turn = rotation(axle, 2.0 * math.pi * k / ROLLERS)
            name, axis = f"{wheel.joint}/roller{k}", turn @ along
            place = wheel.offset * axle + (wheel.radius - b) * (turn @ down)
            roller = body.add_body(name=name, pos=place)
            roller.add_joint(name=name, type=mujoco_library().mjtJoint.mjJNT_HINGE, axis=axis)
            inertia.put(roller)
            pair = self._add(roller, name, "ellipsoid", size, about(axis), self._friction)
            pair.solref = [ROLLER_STEPS * self._settings.timestep, 1.0]
            pair.solimp = ROLLER_IMPEDANCE
            self.owners[name] = wheel.joint
            places.append(place)
        whole = Inertial(float(carried.mass), carried.lever, carried.inertia)
        rest = combined([whole, *(Inertial(-mass, at, -inertia.inertia) for at in places)])
        if is_physical(rest):
            rest.put(body)

    def _add_supports(self) -> None:
        tree = self._robot.tree
        for name, link, shape in support_shapes(self._robot, self._supports):
            rolls = any(not tree.is_upright(joint) for joint in tree.free_joints(link))
            friction = self._friction if rolls else self._settings.caster_friction
            self._on_link(link, name, shape, friction)
            self.owners[name] = name

    def _add_drawn_casters(self) -> None:
        """Add balls for casters that have only mesh shapes."""
        tree = self._robot.tree
        for link in self._supports.unknown:
            head, pose = place_in_body(self._robot, link)
            radius = float(tree.pose(link)[2, 3]) - self._robot.drive.ground
            free = tree.free_joints(link)
            friction = self._friction if free and not tree.is_upright(free[-1]) else 0.0
            body = self._spec.body(body_name(head))
            self._add(body, link, "sphere", [radius, 0.0, 0.0], pose, friction)
            self.notes.append(
                f'caster "{link}" has only mesh shapes; a ball of radius {radius:.3g} m is used'
            )

    def _add_props(self) -> None:
        """Add frictionless balls that hold the robot up."""
        drive = self._robot.drive
        reach = max(0.5 * drive.track, MIN_REACH)
        cos, sin = math.cos(drive.heading), math.sin(drive.heading)
        body = self._spec.body(body_name(self._robot.description.root))
        for k, (ahead, left) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
            pose = np.eye(4)
            pose[0, 3] = drive.point[0] + reach * (cos * ahead - sin * left)
            pose[1, 3] = drive.point[1] + reach * (sin * ahead + cos * left)
            pose[2, 3] = drive.ground + PROP
            self._add(body, f"prop{k}", "sphere", [PROP, 0.0, 0.0], pose, 0.0)
        self.notes.append(
            f"four added frictionless balls hold the robot up, {reach:.3g} m from P along each axis"
        )

    def _add_body(self) -> None:
        """Let all collision shapes of the file except meshes touch the ground."""
        description = self._robot.description
        lines = {part.line for part in self._supports.parts}
        wheels = {description.joint[wheel.joint].child for wheel in self._robot.drive.wheels}
        meshed = set()
        for link in description.links:
            if wheels & {description.root, *(j.child for j in description.chain(link.name))}:
                continue
            for shape in link.collisions:
                if shape.kind == "mesh":
                    meshed.add(link.name)
                elif shape.line not in lines:
                    name = f"{link.name} (line {shape.line})"
                    self._on_link(link.name, name, shape, self._friction)
        if meshed:
            self.notes.append(f"the meshes of {len(meshed)} links do not touch the ground")

    def even(self) -> None:
        """Let contacts sink according to the robot's mass, not to that of a caster's wheel.

        MuJoCo regularises a contact by R = (1 − d)/d w, with its impedance d and the mean inverse
        mass w of its body; see :func:`vertical_inverse_masses`. If w is much larger than the
        inverse mass against vertical forces, the contact gets the d for which R is that of the
        latter.
        MuJoCo divides direct stiffness and damping by d, so they are scaled with d. Rollers have
        hard contacts of their own.
        """
        try:
            model = self._spec.compile()
        except ValueError:
            return  # it is told where the model is needed
        pairs = [
            pair for pair in self._spec.pairs if self.owners.get(pair.name, "") in ("", pair.name)
        ]
        ids = [int(model.geom(pair.name).id) for pair in pairs]
        upwards = vertical_inverse_masses(model, ids)
        for pair, geom, vertical in zip(pairs, ids, upwards.tolist(), strict=True):
            ratio = float(model.body_invweight0[model.geom_bodyid[geom], 0]) / vertical
            if ratio <= ALIKE:
                continue
            before = float(pair.solimp[1])
            pair.solimp[:2] = [_harder(float(d), ratio) for d in pair.solimp[:2]]
            scale = float(pair.solimp[1]) / before
            for numbers in (pair.solref, pair.solreffriction):
                if numbers[0] < 0.0:  # stiffness and damping, not a time constant
                    numbers[:] = [scale * value for value in numbers]


class LeaningContacts(GroundContacts):
    """Adds the contacts of a robot that leans: each tyre touches the ground at one point."""

    def __init__(self, spec: Any, robot: Robot, settings: ContactSettings, friction: float) -> None:
        if settings.props:
            raise RpctlError(
                f"{robot.name} leans on two wheels, so props would hold it upright; leave them "
                "out of [plant.contact]"
            )
        super().__init__(spec, robot, settings, friction)

    def _tread(self, wheel: Wheel) -> tuple[str, list[float]]:
        width = self._settings.wheel_width
        breadth = half_width(wheel) if width is None else 0.5 * width
        return "ellipsoid", [wheel.radius, wheel.radius, breadth]


def _harder(impedance: float, ratio: float) -> float:
    """Return the impedance d for which d/(1 − d) is ``ratio`` times that of a given one."""
    odds = ratio * impedance / (1.0 - impedance)
    return odds / (1.0 + odds)
