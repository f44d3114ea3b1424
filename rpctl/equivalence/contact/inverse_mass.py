"""How a robot's inertia meets a vertical force on its contacts, in MuJoCo."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from typing import Any

import numpy as np

from rpctl.arrays import Array


def vertical_inverse_masses(model: Any, geoms: Iterable[int]) -> Array:
    """Return how vertical forces accelerate geoms' middles vertically (n_geoms,), 1/kg.

    MuJoCo scales a contact's softness by the inverse mass that a body shows in all directions
    (``body_invweight0``). A caster's wheel swings aside about its swivel as if it weighed its own
    few grams, and so MuJoCo presses it in up to a hundred times further than a driven wheel under
    the same load: the robot leans on its casters. Upwards, all of them bear the robot.

    Args:
        model: The ``MjModel``, in its reference posture.
        geoms: Ids of the geoms that meet the ground.
    """
    mujoco: Any = import_module("mujoco")
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    jacobian, moved, found = np.zeros((3, model.nv)), np.zeros((1, model.nv)), []
    for geom in geoms:
        body = int(model.geom_bodyid[geom])
        mujoco.mj_jac(model, data, jacobian, None, data.geom_xpos[geom], body)
        mujoco.mj_solveM(model, data, moved, jacobian[2:])
        found.append(float(jacobian[2] @ moved[0]))
    return np.array(found)
