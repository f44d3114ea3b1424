"""The forward dynamics of a robot's tree in Drake, if it is installed, projected by NumPy."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array


class DrakePeer:
    """A robot with fixed wheels in Drake: Pinocchio's bodies and joints, body by body.

    Args:
        robot: The robot; its base heads along x in all that is asked, so that Drake's velocities of
            the base, which are the world's, are Pinocchio's.

    Raises:
        ImportError: Drake is not installed.
    """

    def __init__(self, robot: Robot) -> None:
        self._tree: Any = import_module("pydrake.multibody.tree")
        self._math: Any = import_module("pydrake.math")
        plant = import_module("pydrake.multibody.plant")
        self.robot, self.plant = robot, plant.MultibodyPlant(0.0)
        model = robot.model
        bodies = [self.plant.world_body()]
        joints = []
        for index in range(1, model.njoints):
            bodies.append(self._body(model, index))
            joints.append(self._joint(model, index, bodies[model.parents[index]], bodies[-1]))
        self.plant.Finalize()
        self._joints = joints
        self._context = self.plant.CreateDefaultContext()
        columns = [j.velocity_start() + k for j in joints for k in range(j.num_velocities())]
        self._columns = np.array(columns)  # of Pinocchio's velocities among Drake's

    def _body(self, model: Any, index: int) -> Any:
        tree, inertia = self._tree, model.inertias[index]
        mass, com, J = inertia.mass, inertia.lever, inertia.inertia
        about = J - mass * (np.outer(com, com) - com @ com * np.eye(3))
        moments = about[0, 0], about[1, 1], about[2, 2], about[0, 1], about[0, 2], about[1, 2]
        unit = tree.UnitInertia(*(each / mass for each in moments))
        spatial = tree.SpatialInertia(mass, com, unit, skip_validity_check=True)
        return self.plant.AddRigidBody(model.names[index], spatial)

    def _joint(self, model: Any, index: int, parent: Any, body: Any) -> Any:
        tree, name = self._tree, model.names[index]
        if index == 1:
            kind = tree.PlanarJoint(name, self.plant.world_frame(), body.body_frame())
            return self.plant.AddJoint(kind)
        place = model.jointPlacements[index]
        rotation = self._math.RotationMatrix(place.rotation)
        pose = self._math.RigidTransform(rotation, place.translation)
        frame = self.plant.AddFrame(
            tree.FixedOffsetFrame(f"before {name}", parent.body_frame(), pose)
        )
        joint = model.joints[index]
        data = joint.createData()
        joint.calc(data, np.eye(1, joint.nq)[0])
        axis = np.asarray(data.S).reshape(6)
        if np.any(axis[:3]):
            kind = tree.PrismaticJoint(name, frame, body.body_frame(), axis[:3])
        else:
            kind = tree.RevoluteJoint(name, frame, body.body_frame(), axis[3:])
        return self.plant.AddJoint(kind)

    def positions(self, q: Array) -> Array:
        """Return Drake's positions at a configuration (nq,) that heads along x."""
        found = np.zeros(self.plant.num_positions())
        for name, joint in zip(self.robot.model.names[1:], self._joints, strict=True):
            start = joint.position_start()
            if joint.num_positions() == 3:
                found[start : start + 3] = *q[:2], 0.0
            else:
                found[start] = self.robot.joint_position(q, name)
        return found

    def forward(self, nu: Array, tau: Array) -> Callable[[Array], Array]:
        """Return what maps Drake's positions to ν̇ (dof,), as a first draft would compute it.

        Args:
            nu: Quasi-velocities (dof,).
            tau: Efforts (n_act,).
        """
        dynamics = ReducedDynamics(self.robot)
        q = self.robot.configuration()
        S = np.zeros((self.plant.num_velocities(), self.robot.dof))
        S[self._columns] = dynamics.basis(q)
        v, push = S @ nu, dynamics.actuation(q) @ tau + dynamics.losses(q, nu)
        x, y, turn = self._columns[:3]
        drift = np.zeros(len(v))  # of the base's velocity in the world, at constant ν
        drift[[x, y]] = -v[turn] * v[y], v[turn] * v[x]
        plant, context = self.plant, self._context

        def run(positions: Array) -> Array:
            plant.SetPositions(context, positions)
            plant.SetVelocities(context, v)
            M = plant.CalcMassMatrix(context)
            bias = plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
            return np.asarray(np.linalg.solve(S.T @ M @ S, push - S.T @ (M @ drift + bias)))

        return run
